"""Data association: the probability that a detection comes from a target.

::

    rows of targets, and their pairs with detections: claims
      |  edges, odds                         shares
    edges (target, detection, odds), clutter
      |  connected targets and detections     clusters
      |  the order of a cluster's edges        planning
      |  sums over all matchings               frontier
      |  clusters beyond all bounds            belief_propagation
    probability of every edge, and of no detection
      |  factors on the rows' weights        shares

`marginals` has these steps in order, and the bound of the work beyond which a cluster is left to
belief propagation. An engine gives `claims.Claims` to `shares`, in compiled code. `evidence` has
what the pairs show besides positions, before and after.
"""
