"""What transponders say of themselves: AIS of ships, ADS-B of aircraft. No ROS.

The path of the bytes::

    Datagram (transport)                    bytes with their time of receipt
      |  lines and frames                   units
    Unit
      |  decode                             ais (pyais), aircraft (rs1090)
    Heard
      |  rules, dates                       transmitters
    Heard with a time
      |  collect for a while                stream
    Batch: the columns of a cloud

`stream` is the whole path. ASTERIX (`asterix`) has positions of its own and shares everything from
the rules on.
"""
