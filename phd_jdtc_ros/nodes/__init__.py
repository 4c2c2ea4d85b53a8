"""The ROS nodes: thin layers that decode messages, step the core, and encode and publish.

::

    tracker                detections to estimates, live
    evaluator, recorder    estimates and truth to scores; records
    replay, playback       a bag's detections and truth to messages, at a chosen rate
    asterix, reports       the live bridges of ASTERIX, and of AIS and ADS-B
    hand_over              estimates of several trackers to one picture
    picture                the live picture in a browser
    common                 start and stop, parameters, QoS overrides
"""
