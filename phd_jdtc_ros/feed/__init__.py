"""Feeds the core's pipeline, for the live node, the offline tracker, the tables and the study.

::

    a message, its bytes or a row of a table
      |  decoded by the caller                 msg_adapters, api
    Report, or a pose
      |  pipeline; notices of unused input     feed
    events: stepped scans, and ended runs

`tally` counts the notices, for callers that report them at the end.
"""
