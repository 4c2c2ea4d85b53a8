"""The fixed-lag window of an engine: entries of past scans, the forward and the backward pass."""
