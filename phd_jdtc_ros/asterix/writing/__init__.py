"""Encodes tracks and plots as ASTERIX."""
