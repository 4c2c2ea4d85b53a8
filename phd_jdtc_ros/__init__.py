"""Joint detection, tracking and classification with PHD smoothing, live on ROS 2."""

__version__ = "0.1.0"
