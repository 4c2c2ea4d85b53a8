"""Recordings of ASTERIX to bags and back, by `asterix_bridge` and `simulate`."""
