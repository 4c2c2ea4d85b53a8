"""Between ROS messages, MCAP bags and the core's values. Knows no node."""
