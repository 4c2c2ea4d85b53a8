"""Conversion between ROS messages and the core's values; independent of nodes."""
