"""The ROS nodes: thin, decode, step, encode, publish."""
