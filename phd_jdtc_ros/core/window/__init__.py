"""The fixed-lag window of an engine: past scans, forward pass with its update, backward pass."""
