"""The ROS nodes: thin layers that decode messages, step the core, and encode and publish.

::

    tracker                detections to estimates, live
    evaluator              estimates and truth to scores; records
    replay                 a bag's detections and truth to messages, at a chosen rate
    common                 start and stop, parameters, QoS overrides
"""
