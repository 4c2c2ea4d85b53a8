"""Candidate pairs of a search, and the exact test.

Searches use two coordinates of the points; only the test uses all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from .intervals import CHUNK_PAIRS, chunks, expand

# Bound on the rounding error of a position, in cells or strips. It may add candidates, but never
# removes one.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Candidates:
    """Candidate pairs of a search: intervals of the sorted points."""

    # Coordinates of the queries by axis, each block's most selective axes first, (K, Q).
    query: FloatArray
    point: FloatArray  # Coordinates of the points by axis likewise, in sorted order, (K, P)
    limit: FloatArray  # Square radius of each query, (Q,)
    rank: IntArray  # Index of the point at each position of the sorted order, (P,)
    owner: IntArray  # The query of each interval, ascending, (I,)
    start: IntArray  # First position of each interval in the sorted order, (I,)
    count: IntArray  # Number of positions of each interval, (I,)


class Pairs(NamedTuple):
    """Queries and points that are near each other."""

    query: IntArray  # Ascending, (pairs,)
    point: IntArray  # (pairs,)
    square: FloatArray  # Square distance, (pairs,)


def near_chunks(found: Candidates) -> Iterator[Pairs]:
    """Test candidates chunk by chunk; yield the near pairs in order."""
    for part in chunks(found.count, CHUNK_PAIRS):
        owner, start, count = found.owner[part], found.start[part], found.count[part]
        query, place, square = _near_pairs(
            found.query, found.point, found.limit, owner, start, count
        )
        yield Pairs(query, found.rank.take(place), square)


def _near_pairs(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the query, the point's index and the square distance of all near pairs.

    For the parameters see `Candidates`; the intervals may be a part of all.
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
