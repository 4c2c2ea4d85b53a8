"""The tracker in Python: tables of detections in, tables of tracks out; no ROS and no bags.

::

    tables       what users have, as columns: mappings, data frames, structured arrays, CSV
      |          cut into the reports of the radars                     reports
    tracker      `Tracker`: parameters, `fit`, `track`, `update`, `flush`
      |          the core's pipeline, as the live node has it
    tables       estimates as a structured array
    scores       `evaluate`: tracks beside the truth
    simulated    `simulate`: detections and truth of a scenario

What is public is in `phd_jdtc_ros` itself: `Tracker`, `simulate` and `evaluate`, their arguments
and the columns of their tables. They do not move as modules do.
"""
