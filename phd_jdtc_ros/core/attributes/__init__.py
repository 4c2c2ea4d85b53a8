"""Transponder data: identities and heights of targets, estimated separately from their states.

::

    labels, gates
      |  plots with false heights, projected at a target's height   reprojection
    pairs of rows and detections
      |  likelihood of the identity and the height                  identity, height
      |  unique identities: of another target, or outside its gate  uniqueness
      |  replies of the targets, reflected to other places          reflections
    log factor of each pair, of clutter and of new targets          evidence
      |  (the engine associates)
    probability of each pair
      |  beliefs about each label                                   records, history, updates
    code, address, z, vz of estimates                               memory

Engines use only `memory.AttributesAt`, `evidence.Evidence` and `reprojection.Paired`. A belief
belongs to a label and is independent of how an engine represents the state.
"""
