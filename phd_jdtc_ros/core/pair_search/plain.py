"""The searches' inner loop in NumPy; `compiled` is the equivalent for numba."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from .intervals import expand


def near_pairs(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the query, the point's index and the square distance of all near pairs.

    For the parameters see `candidates.Candidates`; the intervals may be a part of all.
    """
    row, place = expand(owner, start, count)
    square = np.zeros(len(row))
    # The searched axes leave few false candidates, so that the first test uses three axes at once.
    for axes in (range(min(3, len(query))), range(3, len(query))):
        for axis in axes:
            apart = point[axis].take(place)
            apart -= query[axis].take(row)
            apart *= apart
            square += apart
        near = np.flatnonzero(square <= limit.take(row))
        row, place, square = row.take(near), place.take(near), square.take(near)
    return row, place, square
