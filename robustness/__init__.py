"""The package's behaviour under faults, on live nodes: ``make faults``, ``soak``, ``fuzz``.

Not part of the installed package. The data's path::

    harness         nodes under test as processes in a ROS domain, a peer that publishes scans to
      |             them and receives the tracker's output, and figures with their goals
    reports, hostile_input, operation        faults, on live nodes or in the engine alone
      |
    command         table of faults -> out/<command>/summary.json

All traffic stays on this machine: on loopback, or in network namespaces that are created and
removed here. Every loop is bounded in count and time.
"""
