"""The model that both engines share: targets, sensors and clutter put together.

::

    tracker_model          all models in one value, for an engine
    amplitude_model        use of amplitudes: band, memory, none
    detection_birth        targets that appear anywhere, born at detections
    competing_sources      clutter and unknown targets beside the known ones
    detection_clusters     detections of one object as one
    detection_limit        the detections of one update that can be afforded
    stationary             probability that a target is stationary, from its velocity
    manoeuvre              what a target may do beyond its motion models
    clutter_learning       what a filter learns of each sensor's clutter
    clutter_raster         maps of clutter as a picture of the world
"""
