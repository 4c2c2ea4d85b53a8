"""Target labels: every scan has a block of numbers for its births and spawned targets."""

from __future__ import annotations

from ..arrays import IntArray

LABELS_PER_SCAN = 1 << 24
# Largest number of scans. Labels contain the scan index and must fit 64 bits; at one scan a second
# the limit is reached after 4000 years.
MAX_SCANS = 1 << 37


def first_predicted(scan_index: int) -> int:
    """Return the first label for birth terms and spawned targets of a scan's prediction."""
    return scan_index * LABELS_PER_SCAN


def first_detected(scan_index: int) -> int:
    """Return the first label for targets born at a scan's detections."""
    return scan_index * LABELS_PER_SCAN + LABELS_PER_SCAN // 2


def birth_scan(label: IntArray) -> IntArray:
    """Return the index of the scan in which each label was created."""
    return label // LABELS_PER_SCAN
