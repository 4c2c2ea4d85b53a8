# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""All pairs of points closer than a radius, by sorting and sweeping.

A tracking filter's clouds, whitened by a kernel's noise, are wide in two coordinates and a few
units wide in the others, so a search over two coordinates finds little but true neighbours. Which
two differs from block to block: mostly the positions, but a spawned turn rate is told apart best.
The second coordinate is cut into strips as wide as the radius, points are sorted by (block, strip,
first coordinate), and each query looks up one interval in each of the strips it reaches. What the
intervals hold are its candidates.

Where pairs must be of one group, as of one target's origin, `grid` is faster; where they need not,
this one is (`python -m benchmarks --part searches`).
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from . import kernels
from .candidates import ROUNDING, Candidates

# Axes are chosen on so many queries and points, and on one more of so many.
SAMPLE, SPARSE = 24, 128


def candidates(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float | FloatArray,
) -> Candidates:
    """Return what is to be tested to find every (query, point) pair of one block within a radius.

    Their number, ``count.sum()``, is what a search costs.

    Parameters
    ----------
    query : array of shape (Q, K)
        K at least 2.
    query_block : int array of shape (Q,)
        From 0; only pairs with equal block are compared.
    point : array of shape (P, K)
    point_block : int array of shape (P,)
    radius : float or array of shape (Q,)
        Positive.
    """
    reach = np.full(len(query), radius)
    if len(query) == 0 or len(point) == 0:
        none = np.zeros(0, dtype=np.int64)
        return Candidates(query.T, point.T, reach, none, none, none, none)
    blocks = int(max(query_block.max(), point_block.max())) + 1
    widest = float(reach.max())
    order = _selective_axes(query, query_block, point, point_block, widest, blocks)
    first, second = _columns(point, np.arange(len(point)), point_block, order[:, :2])
    low = float(first.min()) - 2.0 * widest, float(second.min())
    # Strips fit the usual radius; the few larger ones reach beyond the neighbouring strips.
    width = max(float(reach.mean()), widest / 3.0) * (1.0 + ROUNDING)
    beyond = int(np.ceil(widest / width))
    # All strips of all blocks stand one behind the other on a line, with a gap in between that no
    # interval bridges.
    span = float(first.max()) - low[0] + 3.0 * widest
    strips = int((float(second.max()) - low[1]) / width) + 2 * beyond + 3
    strip = np.floor((second - low[1]) / width) + beyond + 1.0
    key = (point_block * strips + strip) * span + (first - low[0])
    rank = np.argsort(key)

    columns = _columns(query, np.arange(len(query)), query_block, order)
    along, height = columns[0] - low[0], (columns[1] - low[1]) / width + beyond + 1.0
    inside = (height >= 0.0) & (height < strips) & (along >= 0.0) & (along <= span - widest)
    owner = np.flatnonzero(inside)
    strip = np.floor(height[owner])
    above = height[owner] - strip
    centre = (query_block[owner] * strips + strip) * span + along[owner]
    # Looked up in sorted order, so that neighbouring places are read one after the other.
    sweep = np.argsort(centre)
    owner = owner[sweep]
    looked_up = _look_up(
        key[rank], centre[sweep], above[sweep], reach[owner] / width, width, span, beyond
    )
    intervals = np.zeros((2, len(query), 2 * beyond + 1), dtype=np.int64)
    intervals[:, owner] = looked_up.transpose(0, 2, 1)
    start, count = intervals.reshape(2, -1)
    kept = np.flatnonzero(count)
    return Candidates(
        query=columns,
        point=_columns(point, rank, point_block[rank], order),
        limit=reach**2,
        rank=rank,
        owner=kept // (2 * beyond + 1),
        start=start[kept],
        count=count[kept],
    )


def _look_up(
    key: FloatArray,
    centre: FloatArray,
    above: FloatArray,
    radius: FloatArray,
    width: float,
    span: float,
    beyond: int,
) -> IntArray:
    """Return the interval of candidates of every query in every strip that it may reach.

    Parameters
    ----------
    key : array of shape (P,)
        The points' places on the line of all strips, ascending.
    centre, above, radius : arrays of shape (M,)
        The queries' places on that line, how far into its strip each stands and how far it
        reaches, the latter two in widths of a strip.
    width, span : float
        Of a strip.
    beyond : int
        How many strips to either side are reached.

    Returns
    -------
    int array of shape (2, 2 beyond + 1, M)
        Start and length.
    """
    found = np.empty((2, 2 * beyond + 1, len(centre)), dtype=np.int64)
    rounding = 4.0 * np.spacing(key[-1] + span)
    for shift in range(-beyond, beyond + 1):
        # Of a circle, a strip so far from its centre holds no more than a chord.
        apart = np.maximum(np.maximum(shift - above, above - shift - 1.0) - ROUNDING, 0.0)
        square = radius * radius - apart * apart
        half = width * np.sqrt(np.maximum(square, 0.0)) + rounding
        middle = centre + shift * span
        start = key.searchsorted(middle - half, side="left")
        found[0, shift + beyond] = start
        found[1, shift + beyond] = key.searchsorted(middle + half, side="right") - start
    return found


def _columns(value: FloatArray, row: IntArray, block: IntArray, axes: IntArray) -> FloatArray:
    """Return some rows' coordinates on the axes of their block.

    Parameters
    ----------
    value : array of shape (N, K)
    row, block : int arrays of shape (M,)
    axes : int array of shape (blocks, A)

    Returns
    -------
    array of shape (A, M)
    """
    flat = np.ascontiguousarray(value).ravel()
    begin = row * value.shape[1]
    columns = np.empty((axes.shape[1], len(row)), order=kernels.chosen().layout)
    for index, axis in enumerate(axes.T):
        columns[index] = flat.take(begin + axis.take(block))
    return columns


def _selective_axes(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float,
    blocks: int,
) -> IntArray:
    """Return for each block its axes, the two that best tell pairs apart first; (blocks, K).

    On a small even sample: the two axes that together leave the fewest pairs. The result is exact
    whatever the order; only the work depends on it.
    """
    size = query.shape[1]
    order = np.tile(np.arange(size), (blocks, 1))
    for block in range(blocks):
        own, others = np.flatnonzero(query_block == block), np.flatnonzero(point_block == block)
        if len(own) == 0 or len(others) == 0:
            continue
        # Of many targets, pairs that are near on two axes are rare: the sample grows with them.
        some, rest = (
            coordinates[rows[:: max(1, len(rows) // (SAMPLE + len(rows) // SPARSE))]].T
            for coordinates, rows in ((query, own), (point, others))
        )
        near = (np.abs(some[:, :, None] - rest[:, None]) <= radius).reshape(size, -1)
        indicator = near.astype(np.float32)  # counts are exact, and products fast
        together = (indicator @ indicator.T).astype(np.float64)
        alone = together.diagonal()
        # Counted and, since few are left to count, also as if the two were independent.
        left = together + np.outer(alone, alone) / near.shape[1]
        np.fill_diagonal(left, np.inf)
        best = divmod(int(left.argmin()), size)
        order[block] = [*best, *(axis for axis in range(size) if axis not in best)]
    return order
