"""When each kind of sensor last saw a target: a primary radar, a secondary one, and Mode S.

A detection may be of several kinds: of a combined radar, both its echo and its answer.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import SENSORS, UNKNOWN, Detections
from .height import BoolArray

# Which sensors a plot is of, by the TYP of I048/020: primary, secondary, both, Mode S all-call and
# roll-call, and both of these with primary.
OF_KIND = np.array(
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
# A detection updates a target that it is of with at least this probability.
LEAST = 0.5


def never(targets: int) -> IntArray:
    """Return the times of targets that no sensor has seen, shape (T, S)."""
    return np.full((targets, len(SENSORS)), UNKNOWN, dtype=np.int64)


def sensors_of(detections: Detections) -> BoolArray:
    """Return which sensors each detection is of, shape (M, S).

    Where its kind is not known, one with an address is of Mode S, another with a code of a
    secondary radar, and any other one of a primary radar.
    """
    none = np.full(len(detections), UNKNOWN)
    code = none if detections.code is None else detections.code
    address = none if detections.address is None else detections.address
    kind = none if detections.kind is None else detections.kind
    supposed = np.where(address != UNKNOWN, 4, np.where(code != UNKNOWN, 2, 1))
    found: BoolArray = OF_KIND[np.where(kind > 0, kind, supposed)]
    return found


def times_of(detections: Detections, stamp_ns: int) -> IntArray:
    """Return when each detection was made, nanoseconds, shape (M,)."""
    if detections.time_s is None:
        return np.full(len(detections), stamp_ns, dtype=np.int64)
    return stamp_ns + np.rint(detections.time_s * 1e9).astype(np.int64)


def updated(
    before: IntArray,
    target: IntArray,
    column: IntArray,
    own: FloatArray,
    detections: Detections,
    stamp_ns: int,
) -> IntArray:
    """Return the times after an association.

    Parameters
    ----------
    before : int array of shape (T, S)
    target, column : int arrays of shape (E,)
        The target and the detection of each edge.
    own : array of shape (E,)
        Probability that the target, if it exists, has the edge's detection.
    detections : Detections
    stamp_ns : int
        Of the scan.
    """
    sure = np.flatnonzero(own >= LEAST)
    said = sensors_of(detections)[column[sure]]
    edge, sensor = np.nonzero(said)
    times = times_of(detections, stamp_ns)[column[sure]][edge]
    after: IntArray = before.copy()
    np.maximum.at(after, (target[sure][edge], sensor), times)
    return after
