"""The sensor-replay node: publishes a bag's detections and truth."""
