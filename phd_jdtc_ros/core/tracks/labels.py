"""Target labels: every scan has a block of numbers for its births and spawned targets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..arrays import IntArray

ORIGINS_PER_SCAN = 1 << 24


def first_predicted(scan_index: int) -> int:
    """Return the first label for birth terms and spawned targets of a scan's prediction."""
    return scan_index * ORIGINS_PER_SCAN


def first_detected(scan_index: int) -> int:
    """Return the first label for targets born at a scan's detections."""
    return scan_index * ORIGINS_PER_SCAN + ORIGINS_PER_SCAN // 2


def first_scan(origin: IntArray) -> IntArray:
    """Return the index of the scan in which each label began."""
    return origin // ORIGINS_PER_SCAN


def is_detected(origin: IntArray) -> npt.NDArray[np.bool_]:
    """Return a mask of labels created by births at detections."""
    detected: npt.NDArray[np.bool_] = origin % ORIGINS_PER_SCAN >= ORIGINS_PER_SCAN // 2
    return detected
