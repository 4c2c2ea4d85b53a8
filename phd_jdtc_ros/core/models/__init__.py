"""The model that both engines share: targets, sensors and clutter put together.

::

    tracker_model          all models in one value, for an engine
    amplitude_model        use of amplitudes: band, memory, none
    detection_birth        births at detections, for targets that appear anywhere
    newborn_sampling       states of newborn targets, and the intensity they are drawn from
    competing_sources      intensity of clutter and of unknown targets at detections
    detection_clusters     merges the detections of one object
    detection_limit        bounds the number of detections of one update
    stationary             probability that a target is stationary, from its velocity
    manoeuvre              deviations from the motion models after a lost track
    learned_sensor         learned values of one sensor, and the sensor with these
    sensor_memory          the learned values of all sensors, updated from scan to scan
    clutter_raster         renders clutter maps as a raster of the world
"""
