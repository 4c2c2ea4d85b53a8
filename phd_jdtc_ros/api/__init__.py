"""The tracker in Python: tables of detections in, tables of tracks out, without ROS and bags.

::

    tables       a user's table as columns: mapping, data frame, structured array, CSV
      |          latitudes and longitudes to x and y, split by sensor   reports
      |          given, estimated and default parameters                parameters
    tracker      `Tracker`: parameters, `fit`, `track`, `update`, `flush`
      |          runs the core's pipeline, as the live node does
    tables       estimates as a structured array
    scores       `evaluate`: compares tracks with the truth
                 `simulate`: detections and truth of a scenario

The public API is `Tracker`, `simulate` and `evaluate` in `phd_jdtc_ros` itself, with their
arguments and the columns of their tables. It stays stable when modules move.
"""
