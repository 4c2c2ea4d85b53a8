"""Reads and writes parameter files, without ROS."""
