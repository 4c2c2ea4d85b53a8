"""Estimates the biases of radars (registration) and tracker parameters (tuning) from recordings."""
