# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the package does under faults, measured on live nodes: ``make faults``, ``soak``, ``fuzz``.

Not part of the installed package. The way of a figure::

    rig         a ROS domain of its own: the nodes under test as processes, and
    radars      a peer beside them that publishes scans and hears what comes back
      |
    scans, bad_scans, stamps_and_time, overload, restarts    faults, on live nodes
    warm_restart, publishers
    bags, recordings, network                                files, disks, rogue peers
    soak, decoders, raw_bytes                                a day of scans; random input
      |
    figures -> report (table), out/<command>/summary.json

All traffic stays on this machine: loopback, or network namespaces that are made and removed here.
Every loop is bounded in count and time.
"""
