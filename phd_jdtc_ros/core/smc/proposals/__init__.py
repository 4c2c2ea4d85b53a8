"""Proposal densities: process noise and velocities drawn given the detections."""
