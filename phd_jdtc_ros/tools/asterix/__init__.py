"""Converts recordings of ASTERIX to bags and back, for `asterix_bridge` and `simulate`."""
