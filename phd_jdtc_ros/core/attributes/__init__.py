"""Transponder data: identities and heights of targets, estimated beside their states.

::

    labels, gates
      |  plots with false heights, projected at a target's height   readings
    pairs of targets and detections
      |  likelihood of the identity and the height             identity, height
      |  unique identities: already taken, or of a lost target  uniqueness
    log factor of each pair, of clutter and of new targets: memory.AttributeMemory.evidence
      |  (the engine associates)
    probability of each pair: memory.AttributeMemory.learn
      |  beliefs about each label
    code, address, z, vz of estimates: memory.AttributeMemory.describe

Engines use only `memory.AttributeMemory` and `readings.Paired`. A belief belongs to a label and is
independent of how an engine represents the state.
"""
