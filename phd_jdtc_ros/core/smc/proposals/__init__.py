"""Proposal densities: process noise and velocities drawn with the detections in sight."""
