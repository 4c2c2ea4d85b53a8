"""The fixed-lag window of an engine: past scans, the forward pass with its update, the backward pass."""
