"""Simulated hour-long recordings, tracked with the user's commands and no configuration."""
