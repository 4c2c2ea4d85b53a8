"""Tracks and plots to the bytes of ASTERIX."""
