"""The nodes under test, a peer that sends scans, and the figures that a fault is judged by."""
