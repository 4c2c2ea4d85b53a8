"""The tracker node.

::

    node                   life cycle, parameters, services
    settings               the parameters together, and their changes
    live                   the path of a message: decode, pipeline, publish
    inputs, outputs        subscriptions and publishers
    endpoints              their QoS and its faults
    health                 diagnostics of inputs, steps (too slow?), outputs and registration
    checkpoint             warm restart
    peers                  at most one tracker per name, and the bond to a lifecycle manager
"""
