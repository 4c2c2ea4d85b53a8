"""The tracker node.

::

    node                   life cycle, parameters, services
    live                   the path of a message: decode, pipeline, publish
    endpoints, outputs     topics and their QoS
    health                 diagnostics of inputs, steps and outputs
    checkpoint             warm restart
    name_claim             at most one tracker per name
    settings               the parameters of the node
"""
