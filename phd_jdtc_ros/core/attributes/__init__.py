"""What transponders tell: identities and heights of targets, beside their states.

::

    origins, gates
      |  detections of false heights, read at those of the origins   readings
    origins, their pairs with detections
      |  what an identity, a height is worth as evidence       identity, height
      |  unique ones: taken by other targets, or lost          uniqueness
    log factor of each pair, of clutter and of new targets: memory.AttributeMemory.evidence
      |  (the engine associates)
    probability of each pair: memory.AttributeMemory.learn
      |  beliefs of each origin
    code, address, z, vz of estimates: memory.AttributeMemory.told

Both engines use `memory.AttributeMemory` and `readings.Paired` and nothing else here. Beliefs are
of an origin, whatever represents its state.
"""
