"""Time of each target's last detection by primary radar, by secondary radar and by Mode S.

A plot of a combined radar, with an echo and a reply, counts for several detection types.
"""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...types import SENSORS, UNKNOWN, Detections

# Sensor types of a plot, by the TYP of I048/020: none, primary, secondary, both, Mode S all-call
# and roll-call, and the last two with primary.
OF_TYPE = np.array(
    [
        [False, False, False],
        [True, False, False],
        [False, True, False],
        [True, True, False],
        [False, False, True],
        [False, False, True],
        [True, False, True],
        [True, False, True],
    ]
)


def never(targets: int) -> IntArray:
    """Return the times of targets that no sensor has detected, shape (T, S)."""
    return np.full((targets, len(SENSORS)), UNKNOWN, dtype=np.int64)


def sensors_of(detections: Detections) -> BoolArray:
    """Return a mask of the detection types of each detection, shape (M, S).

    Without a given type, a detection with an address counts as Mode S, one with a code as
    secondary radar, and any other as primary radar.
    """
    none = np.full(len(detections), UNKNOWN)
    code = none if detections.code is None else detections.code
    address = none if detections.address is None else detections.address
    detection_type = none if detections.detection_type is None else detections.detection_type
    implied = np.where(address != UNKNOWN, 4, np.where(code != UNKNOWN, 2, 1))
    return OF_TYPE[np.where(detection_type > 0, detection_type, implied)]


def times_of(detections: Detections, stamp_ns: int) -> IntArray:
    """Return the time of each detection, nanoseconds, shape (M,)."""
    if detections.time_s is None:
        return np.full(len(detections), stamp_ns, dtype=np.int64)
    return stamp_ns + np.rint(detections.time_s * 1e9).astype(np.int64)


def update(
    seen_ns: IntArray,
    target: IntArray,
    column: IntArray,
    probability: FloatArray,
    detections: Detections,
    stamp_ns: int,
) -> IntArray:
    """Return the times of targets, (T, S), after an association at a scan's stamp.

    `target` and `column` have the target and the detection of each edge, and `probability` that of
    the edge, given that its target exists, (E,).
    """
    # Smallest association probability with which a detection updates a target's times.
    min_probability = 0.5
    sure = np.flatnonzero(probability >= min_probability)
    sensors = sensors_of(detections)[column[sure]]
    edge, sensor = np.nonzero(sensors)
    times = times_of(detections, stamp_ns)[column[sure]][edge]
    updated: IntArray = seen_ns.copy()
    np.maximum.at(updated, (target[sure][edge], sensor), times)
    return updated
