"""Clutter models: the rate, the amplitudes and a map of false detections."""
