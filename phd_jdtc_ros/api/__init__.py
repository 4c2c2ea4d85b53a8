"""The tracker in Python: tables of detections in, tables of tracks out, without ROS and bags.

::

    tables       a user's table as columns: mapping, data frame, structured array, CSV
      |          latitudes and longitudes become x and y                places
      |          split into the reports of the sensors                  reports
    tracker      `Tracker`: parameters, `fit`, `track`, `update`, `flush`
      |          runs the core's pipeline, as the live node does
    tables       estimates as a structured array
    scores       `evaluate`: compares tracks with the truth
    simulated    `simulate`: detections and truth of a scenario

The public API is `Tracker`, `simulate` and `evaluate` in `phd_jdtc_ros` itself, with their
arguments and the columns of their tables. It stays stable when modules move.
"""
