"""Data association: the probability that a detection comes from a target.

::

    rows of targets, and their pairs with detections: claims
      |  edges, odds                         shares
    edges (target, detection, odds), clutter
      |  connected targets and detections     clusters
      |  the order of a cluster's edges        planning
      |  sums over all matchings               frontier
      |  clusters beyond all bounds            belief_propagation
    probability of every edge, and of no detection: marginals
      |  factors on the rows' weights        shares

An engine gives `claims.Claims` to `shares`, in compiled code.
"""
