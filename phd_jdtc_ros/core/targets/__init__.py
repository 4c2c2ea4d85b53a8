"""Models of targets.

::

    motion, turn_matrix  mean, Jacobian and process noise of a motion
    modes                classes and motion modes: transition and survival probabilities
    birth                births at known places, and spawned targets
    amplitude_density    amplitudes and p_D of Swerling targets, and of noise
    stationary           whether a target is at rest
"""
