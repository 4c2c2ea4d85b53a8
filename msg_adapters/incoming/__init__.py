"""Messages of sensors to `Detections` and `Pose`, and back for simulated bags.

`readers` lists the messages of detections; `phd_jdtc_ros.columns` keeps the valid points.
"""
