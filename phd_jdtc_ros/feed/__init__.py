"""What drives the core's pipeline: the live node, the offline tracker, the tables and the study.

::

    a message, its bytes or a row of a table
      |  decoded by the caller                 msg_adapters, api
    Report, or a pose
      |  pipeline; what is not used is noticed      feed
    events: scans that were stepped, runs that ended

`tally` counts what was noticed, for those that report it in the end.
"""
