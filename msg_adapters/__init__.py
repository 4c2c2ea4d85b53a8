"""Conversion between ROS messages and the core's values; independent of nodes.

The packages import downwards only; a contract in ``pyproject.toml`` enforces this::

    incoming, outgoing    messages of sensors; the table of a tracker's outputs
    targets               estimates and truth as messages
    encoding              types, bytes, columns, stamps: the parts of every message
"""
