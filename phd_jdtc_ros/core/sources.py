"""The names of what a tracker reports: estimates of the newest scan, and of one some scans ago."""

from __future__ import annotations

FILTERED, SMOOTHED = SOURCES = ("filtered", "smoothed")
