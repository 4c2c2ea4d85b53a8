"""All pairs of points closer than a radius, by sorting and sweeping.

A tracking filter's clouds, whitened by a kernel's noise, are wide in two coordinates and a few
units wide in the others, so a search over two coordinates finds little but true neighbours. Which
two differs from block to block: mostly the positions, but a spawned turn rate is told apart best.
The second coordinate is cut into strips as wide as the radius, points are sorted by (block, strip,
first coordinate), and each query looks up one interval in three strips.
"""

from __future__ import annotations

import itertools

import numpy as np

from .types import FloatArray, IntArray

# Candidate pairs tested at a time: temporaries stay near 2 MB, inside the cache and far below
# where the allocator starts to hand pages back and fault them in again.
CHUNK_PAIRS = 1 << 18
SAMPLE = 48


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
        From 0; only pairs with equal block are compared.
    point : array of shape (P, K)
    point_block : int array of shape (P,)
    radius : float

    Returns
    -------
    query_index, point_index : int arrays of shape (pairs,)
    square_distance : array of shape (pairs,)
    """
    if len(query) == 0 or len(point) == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    blocks = int(max(query_block.max(), point_block.max())) + 1
    order = _selective_axes(query, query_block, point, point_block, radius, blocks)
    query = np.take_along_axis(query, order[query_block], axis=1)
    point = np.take_along_axis(point, order[point_block], axis=1)
    low = point.min(axis=0)
    # Wide enough that the intervals of neighbouring strips cannot touch.
    span = float(np.ptp(point[:, 0])) + 4.0 * radius
    strips = int(np.ptp(point[:, 1]) / radius) + 4

    def key(block: IntArray, strip: FloatArray, along: FloatArray) -> FloatArray:
        ranked: FloatArray = (block * strips + strip) * span + (along - low[0] + radius)
        return ranked

    strip = np.floor((point[:, 1] - low[1]) / radius) + 1.0
    point_key = key(point_block, strip, point[:, 0])
    rank = np.argsort(point_key, kind="stable")
    point_key = point_key[rank]

    strip = np.floor((query[:, 1] - low[1]) / radius) + 1.0
    along = query[:, 0] - low[0] + radius
    inside = (strip >= 0.0) & (strip < strips - 1) & (along >= 0.0) & (along <= span - radius)
    owner = np.flatnonzero(inside)
    # Sorted queries look up neighbouring places, which the cache rewards.
    owner = owner[np.argsort(key(query_block[owner], strip[owner], query[owner, 0]))]
    begin, end = [], []
    for shift in (-1.0, 0.0, 1.0):
        centre = key(query_block[owner], strip[owner] + shift, query[owner, 0])
        begin.append(np.searchsorted(point_key, centre - radius, side="left"))
        end.append(np.searchsorted(point_key, centre + radius, side="right"))
    start = np.concatenate(begin)
    count = np.concatenate(end) - start
    row, slot, square = _test_candidates(
        query, point[rank], np.tile(owner, 3), start, count, radius
    )
    return row, rank[slot], square


def _selective_axes(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float,
    blocks: int,
) -> IntArray:
    """Return for each block the order in which axes best tell pairs apart, shape (blocks, K).

    Greedily, on a small even sample: each next axis leaves the fewest of the pairs that those
    before it leave. The result is exact whatever the order; only the work depends on it.
    """
    order = np.tile(np.arange(query.shape[1]), (blocks, 1))
    for block in range(blocks):
        own, others = np.flatnonzero(query_block == block), np.flatnonzero(point_block == block)
        if len(own) == 0 or len(others) == 0:
            continue
        some = query[own[:: max(1, len(own) // SAMPLE)]]
        rest = point[others[:: max(1, len(others) // SAMPLE)]]
        near = np.abs(some[:, None] - rest[None]).reshape(-1, query.shape[1]) <= radius
        left = np.arange(query.shape[1])
        for position in range(len(left)):
            best = near[:, left].sum(axis=0).argmin()
            order[block, position] = left[best]
            near = near[near[:, left[best]]]
            left = np.delete(left, best)
    return order


def _test_candidates(
    query: FloatArray,
    point: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
    radius: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Expand intervals of candidates, chunk by chunk, and keep the pairs that are truly near.

    Interval i holds the points ``start[i]`` to ``start[i] + count[i]`` of query ``owner[i]``.
    """
    # Axis by axis over contiguous columns, the second first, since the first is known to be near:
    # most candidates go at once, and the other axes are looked up for the rest only.
    axes = [1, 0, *range(2, query.shape[1])]
    columns = [(query[:, axis].copy(), point[:, axis].copy()) for axis in axes]
    nonempty = np.flatnonzero(count)
    owner, start, count = owner[nonempty], start[nonempty], count[nonempty]
    running = np.cumsum(count)
    total = int(running[-1]) if len(running) else 0
    bounds = np.searchsorted(running, np.arange(0, total, CHUNK_PAIRS), side="right")
    bounds = np.append(np.unique(bounds), len(count))
    found = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))]
    for first, last in itertools.pairwise(bounds):
        size = count[first:last]
        row = np.repeat(owner[first:last], size)
        slot = np.arange(len(row)) + np.repeat(start[first:last] - np.cumsum(size) + size, size)
        square = np.zeros(len(row))
        for query_axis, point_axis in columns:
            square += (query_axis[row] - point_axis[slot]) ** 2
            near = np.flatnonzero(square <= radius**2)
            if len(near) < len(row):
                row, slot, square = row[near], slot[near], square[near]
        found.append((row, slot, square))
    rows, slots, squares = zip(*found, strict=True)
    return np.concatenate(rows), np.concatenate(slots), np.concatenate(squares)
