"""Finds all pairs of points closer than a radius, by sort and sweep.

Particles whitened by a kernel's noise are spread widely in two coordinates and over a few units in
the others, so that a search over two coordinates finds few false candidates. The best two depend on
the block: mostly the positions, for spawned targets also the turn rate. The second coordinate is
cut into strips as wide as the radius, and points are sorted by (block, strip, first coordinate).
Each query looks up one interval in each strip that it reaches. The points in these intervals are
its candidates.

Where both points of a pair must belong to one group, such as the label of one target, `grid` is
faster; elsewhere the sweep is faster (`python -m benchmarks --part searches`).
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from .candidates import ROUNDING, Candidates, block_columns

# Size of the sample of queries and of points from which axes are selected: `SAMPLE`, and one more
# for every `SPARSE` rows.
SAMPLE, SPARSE = 24, 128


def candidates(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float | FloatArray,
) -> Candidates:
    """Return the candidates for all (query, point) pairs of one block within a radius.

    The number of candidates, ``count.sum()``, determines the cost of a search. Queries are of shape
    (Q, K) and points (P, K), K at least 2. Blocks begin at 0; only pairs with equal block are
    compared. The radius, one number or one for each query, is positive.
    """
    reach = np.full(len(query), radius)
    if len(query) == 0 or len(point) == 0:
        empty = np.zeros(0, dtype=np.int64)
        return Candidates(query.T, point.T, reach, empty, empty, empty, empty)
    blocks = int(max(query_block.max(), point_block.max())) + 1
    widest = float(reach.max())
    order = _selective_axes(query, query_block, point, point_block, widest, blocks)
    first, second = block_columns(point, np.arange(len(point)), point_block, order[:, :2])
    low = float(first.min()) - 2.0 * widest, float(second.min())
    # Strips are as wide as the mean radius; larger radii reach beyond the neighbouring strips.
    width = max(float(reach.mean()), widest / 3.0) * (1.0 + ROUNDING)
    beyond = int(np.ceil(widest / width))
    # All strips of all blocks are placed one after the other on a line, with gaps that are longer
    # than any interval.
    span = float(first.max()) - low[0] + 3.0 * widest
    strips = int((float(second.max()) - low[1]) / width) + 2 * beyond + 3
    strip = np.floor((second - low[1]) / width) + beyond + 1.0
    key = (point_block * strips + strip) * span + (first - low[0])
    rank = np.argsort(key)

    columns = block_columns(query, np.arange(len(query)), query_block, order)
    along, height = columns[0] - low[0], (columns[1] - low[1]) / width + beyond + 1.0
    inside = (height >= 0.0) & (height < strips) & (along >= 0.0) & (along <= span - widest)
    owner = np.flatnonzero(inside)
    strip = np.floor(height[owner])
    above = height[owner] - strip
    centre = (query_block[owner] * strips + strip) * span + along[owner]
    # The look-up is in sorted order, so that memory is read in order.
    sweep = np.argsort(centre)
    owner = owner[sweep]
    found = _look_up(
        key[rank], centre[sweep], above[sweep], reach[owner] / width, width, span, beyond
    )
    intervals = np.zeros((2, len(query), 2 * beyond + 1), dtype=np.int64)
    intervals[:, owner] = found.transpose(0, 2, 1)
    start, count = intervals.reshape(2, -1)
    nonempty = np.flatnonzero(count)
    return Candidates(
        query=columns,
        point=block_columns(point, rank, point_block[rank], order),
        limit=reach**2,
        rank=rank,
        owner=nonempty // (2 * beyond + 1),
        start=start[nonempty],
        count=count[nonempty],
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
    """Return each query's interval of candidates in each strip that it may reach.

    `key` has the positions of the points on the line of all strips, ascending, (P,), and `centre`
    those of the queries, (M,). Their offsets `above` the beginning of their strips, and their
    radii, are in units of a strip's width. `span` is a strip's length on the line, and `beyond` the
    number of strips reached to either side. The intervals are starts and lengths, (2, 2 beyond + 1,
    M).
    """
    intervals = np.empty((2, 2 * beyond + 1, len(centre)), dtype=np.int64)
    rounding = 4.0 * np.spacing(key[-1] + span)
    for shift in range(-beyond, beyond + 1):
        # The circle is only as wide as its chord at this distance from the centre.
        distance = np.maximum(np.maximum(shift - above, above - shift - 1.0) - ROUNDING, 0.0)
        square = radius * radius - distance * distance
        half = width * np.sqrt(np.maximum(square, 0.0)) + rounding
        middle = centre + shift * span
        start = key.searchsorted(middle - half, side="left")
        intervals[0, shift + beyond] = start
        intervals[1, shift + beyond] = key.searchsorted(middle + half, side="right") - start
    return intervals


def _selective_axes(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float,
    blocks: int,
) -> IntArray:
    """Return the axes of each block, the two most selective ones first; shape (blocks, K).

    They are the two axes that together leave the fewest pairs of a small, regular sample. The
    search is exact for any order of axes; only its cost depends on the order.
    """
    size = query.shape[1]
    order = np.tile(np.arange(size), (blocks, 1))
    for block in range(blocks):
        query_rows = np.flatnonzero(query_block == block)
        point_rows = np.flatnonzero(point_block == block)
        if len(query_rows) == 0 or len(point_rows) == 0:
            continue
        # The sample grows with the targets: pairs that are near in two axes become rare.
        query_sample, point_sample = (
            coordinates[rows[:: max(1, len(rows) // (SAMPLE + len(rows) // SPARSE))]].T
            for coordinates, rows in ((query, query_rows), (point, point_rows))
        )
        is_near = (np.abs(query_sample[:, :, None] - point_sample[:, None]) <= radius).reshape(
            size, -1
        )
        indicator = is_near.astype(np.float32)  # counts are exact and products fast
        near_on_both = (indicator @ indicator.T).astype(np.float64)
        near_on_one = near_on_both.diagonal()
        # The count of pairs near in both axes is small and noisy. The count expected of independent
        # axes is added.
        expected_pairs = near_on_both + np.outer(near_on_one, near_on_one) / is_near.shape[1]
        np.fill_diagonal(expected_pairs, np.inf)
        best = divmod(int(expected_pairs.argmin()), size)
        order[block] = [*best, *(axis for axis in range(size) if axis not in best)]
    return order
