"""Tracks of a filter's targets: labels, track numbers, confirmation and reporting."""
