"""The package's behaviour under faults, on live nodes: ``make faults``, ``soak``, ``fuzz``.

Not part of the installed package. The data's path::

    rig         a ROS domain with the nodes under test as processes
    radars      a peer in this domain that publishes scans and receives the tracker's output
      |
    scans, bad_scans, stamps_and_time, overload, restarts    faults, on live nodes
    warm_restart, publishers
    bags, recordings, network                                files, disks, rogue peers
    crowd, forgeries, bombs, numerics                        input that is made to harm
    absurd, hostile, flood
    soak, decoders, raw_bytes                                a day of scans; random input
      |
    engines     which engine the trackers have
      |
    figures, command (table of faults) -> out/<command>/summary.json

All traffic stays on this machine: on loopback, or in network namespaces that are created and
removed here. Every loop is bounded in count and time.
"""
