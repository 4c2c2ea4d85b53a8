"""The configuration: parameters are checked and turned into a tracker.

::

    dotted names and values
      |  unknown names, types and bounds     schema
      |  dataclasses that declare them       parameters
      |  kinds of sensors, names in lists    tables
      |  consistency with each other         models, sensor_models
      |  units, matrices, models             models, sensor_models
    TrackerConfig                            build
      |                                      engines
    engine, pipeline
"""
