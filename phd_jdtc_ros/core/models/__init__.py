"""The model of a tracker: targets, sensors and factors put together.

::

    tracker_model          all models in one value
    amplitude_model        use of amplitudes: band, memory, none
    detection_birth        births at detections, for targets that appear anywhere
    zones                  polygons in which no target is born, or whose entry is an alarm
    competing_sources      intensity of clutter and of undetected targets at detections
    detection_clusters     merges the detections of one object
"""
