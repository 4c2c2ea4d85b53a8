"""A sensor's detection probability and noise, learned while the tracker runs."""
