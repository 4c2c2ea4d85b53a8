"""The configuration: parameters are checked and turned into a tracker.

::

    dotted names and values
      |  type and bounds of each             schema (a parameter), forms (its notation)
      |  dataclasses that declare them       parameters, radar_parameters
      |  consistency with each other         checks
      |  units, matrices, models             models
    TrackerConfig                            build
      |                                      engines
    engine, pipeline
"""
