"""Simulated hours of radars as they are recorded, tracked the way a user does, with nothing set."""
