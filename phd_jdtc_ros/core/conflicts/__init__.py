"""Dangers: tracks that come near own ship or each other, or that enter zones.

::

    possible paths of the tracks           engine.paths, by gaussian.paths; heights: model
      |  share that comes too near          watch
    Conflicts: probability, time, CPA       model
      |  threshold, hysteresis              watch
    alarms                                  watch: the path of a step

A probability is the share of the possible paths on which it happens, so that it takes the joint
covariances, the hypotheses of association and the motion modes into account.
"""
