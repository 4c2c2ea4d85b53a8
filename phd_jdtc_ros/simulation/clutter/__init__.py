"""Detections of no target, and targets seen where they are not."""
