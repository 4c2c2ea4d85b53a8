"""Messages of sensors to `Detections` and `Pose`, and back for simulated bags.

`readers` lists the messages of detections; `selection` keeps the valid points of any of them.
"""
