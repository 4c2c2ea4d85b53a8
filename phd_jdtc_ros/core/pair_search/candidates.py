"""Candidate pairs of a search, and the exact test.

Searches use two coordinates of the points; only the test uses all of them. A search gives every
query intervals of a sorted list. Expanding all of them at once would need temporary arrays of many
megabytes, which do not fit the cache and cause page faults.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray

# Number of candidates per chunk: temporary arrays of 256 kB fit the second-level cache.
CHUNK_PAIRS = 1 << 15
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


def chunks(count: IntArray, most: int) -> Iterator[slice]:
    """Yield slices of the intervals, with about `most` candidates each, given their lengths."""
    running = np.cumsum(count)
    total = int(running[-1]) if len(running) else 0
    bounds = np.searchsorted(running, np.arange(0, total, most), side="right")
    for first, last in itertools.pairwise(np.append(np.unique(bounds), len(count))):
        yield slice(first, last)


def expand(owner: IntArray, start: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Return the owner and the index of every candidate.

    Interval i of query ``owner[i]`` has the indices from ``start[i]`` to ``start[i] + count[i]``,
    the last excluded.
    """
    index = np.arange(count.sum())
    index += (start - np.cumsum(count) + count).repeat(count)
    return owner.repeat(count), index


def block_columns(value: FloatArray, row: IntArray, block: IntArray, axes: IntArray) -> FloatArray:
    """Return some rows' coordinates on the axes of their block, (A, M); `axes` is (blocks, A)."""
    flat = np.ascontiguousarray(value).ravel()
    begin = row * value.shape[1]
    columns = np.empty((axes.shape[1], len(row)))
    for index, axis in enumerate(axes.T):
        columns[index] = flat.take(begin + axis.take(block))
    return columns


def near_chunks(candidates: Candidates) -> Iterator[Pairs]:
    """Test candidates chunk by chunk; yield the near pairs in order."""
    for chunk in chunks(candidates.count, CHUNK_PAIRS):
        owner = candidates.owner[chunk]
        start = candidates.start[chunk]
        count = candidates.count[chunk]
        query, position, square = _near_pairs(
            candidates.query, candidates.point, candidates.limit, owner, start, count
        )
        yield Pairs(query, candidates.rank.take(position), square)


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
    row, position = expand(owner, start, count)
    square = np.zeros(len(row))
    # The searched axes leave few false candidates, so that the first test uses three axes at once.
    for axes in (range(min(3, len(query))), range(3, len(query))):
        for axis in axes:
            difference = point[axis].take(position)
            difference -= query[axis].take(row)
            difference *= difference
            square += difference
        inside = np.flatnonzero(square <= limit.take(row))
        row, position, square = row.take(inside), position.take(inside), square.take(inside)
    return row, position, square
