"""All pairs of points closer than a radius, by sorting and sweeping.

A tracking filter's clouds, whitened by the process noise, are wide in two coordinates (the
positions) and a few units wide in all others. So a search over two coordinates finds nearly
nothing but true neighbours: the second is cut into strips as wide as the radius, points are sorted
by (block, strip, first coordinate), and each query looks up one interval in three strips.
"""

from __future__ import annotations

import numpy as np

from .types import FloatArray, IntArray

# Candidate pairs tested at a time: temporaries stay near 16 MB, below where the allocator starts
# to hand pages back and fault them in again.
CHUNK_PAIRS = 1 << 18


def pairs_within(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Find every (query, point) pair of one block at most `radius` apart.

    Parameters
    ----------
    query : array of shape (Q, K)
    query_block : int array of shape (Q,)
        Only pairs with equal block are compared.
    point : array of shape (P, K)
    point_block : int array of shape (P,)
    radius : float

    Returns
    -------
    query_index, point_index : int arrays of shape (pairs,)
    square_distance : array of shape (pairs,)
    """
    none = np.zeros(0, dtype=np.int64)
    if len(query) == 0 or len(point) == 0:
        return none, none, np.zeros(0)
    wide, second = _widest_axes(point)
    low = point.min(axis=0)
    span = float(np.ptp(point[:, wide])) + 4.0 * radius  # wider than any query's interval
    strips = int(np.ptp(point[:, second]) / radius) + 4

    point_strip = np.floor((point[:, second] - low[second]) / radius) + 1.0
    key = (point_block * strips + point_strip) * span + (point[:, wide] - low[wide] + radius)
    order = np.argsort(key, kind="stable")
    key = key[order]

    query_strip = np.floor((query[:, second] - low[second]) / radius) + 1.0
    inside = np.flatnonzero((query_strip >= 0.0) & (query_strip < strips - 1))
    across = query[inside, wide] - low[wide] + radius
    inside = inside[(across >= 0.0) & (across <= span - radius)]
    across = query[inside, wide] - low[wide] + radius

    first, last = [], []
    for shift in (-1.0, 0.0, 1.0):
        base = (query_block[inside] * strips + query_strip[inside] + shift) * span + across
        first.append(np.searchsorted(key, base - radius, side="left"))
        last.append(np.searchsorted(key, base + radius, side="right"))
    begin = np.stack(first, axis=1).ravel()
    count = np.stack(last, axis=1).ravel() - begin
    owner = np.repeat(inside, 3)
    return _test_candidates(query, point[order], order, owner, begin, count, radius, (second, wide))


def _widest_axes(point: FloatArray) -> tuple[int, int]:
    ranked = np.argsort(np.ptp(point, axis=0), kind="stable")
    return int(ranked[-1]), int(ranked[-2])


def _test_candidates(
    query: FloatArray,
    sorted_point: FloatArray,
    order: IntArray,
    owner: IntArray,
    begin: IntArray,
    count: IntArray,
    radius: float,
    wide_axes: tuple[int, int],
) -> tuple[IntArray, IntArray, FloatArray]:
    """Expand the intervals chunk by chunk and keep the pairs that are truly near."""
    # Axis by axis over contiguous columns, the wide ones first: they reject most candidates, so
    # the others are gathered for a fraction of them.
    axes = [*wide_axes, *(axis for axis in range(query.shape[1]) if axis not in wide_axes)]
    columns = [(query[:, axis].copy(), sorted_point[:, axis].copy()) for axis in axes]
    running = np.cumsum(count)
    cuts = np.searchsorted(running, np.arange(CHUNK_PAIRS, running[-1] + CHUNK_PAIRS, CHUNK_PAIRS))
    found = []
    start = 0
    for stop in np.unique(np.minimum(cuts + 1, len(count))):
        size = count[start:stop]
        row = np.repeat(owner[start:stop], size)
        slot = np.arange(len(row)) + np.repeat(begin[start:stop] - np.cumsum(size) + size, size)
        square = np.zeros(len(row))
        for query_axis, point_axis in columns:
            square += (query_axis[row] - point_axis[slot]) ** 2
            near = np.flatnonzero(square <= radius**2)
            if len(near) < 0.7 * len(row):
                row, slot, square = row[near], slot[near], square[near]
        near = np.flatnonzero(square <= radius**2)
        found.append((row[near], order[slot[near]], square[near]))
        start = stop
    rows, points, squares = zip(*found, strict=True)
    return np.concatenate(rows), np.concatenate(points), np.concatenate(squares)
