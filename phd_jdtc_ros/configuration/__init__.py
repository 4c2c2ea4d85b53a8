"""The configuration: parameters are checked and turned into a tracker.

::

    dotted names and values
      |  type and bounds of each             schema (a parameter), parameters, radar_parameters
      |  consistency with each other         checks
      |  units, matrices, models             build, radar_build
    TrackerConfig
"""
