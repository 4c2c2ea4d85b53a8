"""Search within groups: every group's points are sorted into a grid of cells.

Where both points of a pair must belong to one group, such as the label of one target, there are
many small groups. Each has its own grid over the two axes in which its points extend farthest. The
candidates of a query are looked up in a table of cells, without sorting or searching coordinates.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, run_starts
from .candidates import ROUNDING, Candidates, block_columns

# Ratio of a cell's height, which is the radius, to its width. Narrow cells leave few points of a
# row of cells outside the circle.
ASPECT = 3
# Largest number of cells per point; widely spread groups get larger cells.
MAX_CELLS_PER_POINT = 8


def grid_candidates(
    query: FloatArray,
    query_group: IntArray,
    point: FloatArray,
    point_group: IntArray,
    radius: float,
) -> Candidates:
    """Return the candidates for all (query, point) pairs of one group at most `radius` apart.

    Queries are of shape (Q, K) and points (P, K), K at least 2; neither may be empty. Groups begin
    at 0. The radius is in the units of the coordinates: standard deviations if they are whitened.
    """
    groups = 1 + int(max(query_group.max(), point_group.max()))
    by_axis = np.ascontiguousarray(point.T)
    low, extent = _extents(by_axis, point_group, groups)
    axes = np.argsort(-extent, axis=1, kind="stable")[:, :2]
    corner, grid_extent = (np.take_along_axis(column, axes, axis=1).T for column in (low, extent))
    finest = np.array([[radius / ASPECT], [radius]])
    points = np.bincount(point_group, minlength=groups)
    cells, most = grid_extent / finest, MAX_CELLS_PER_POINT * np.maximum(points, 1)
    # The second bound applies to points on a line, whose area is zero.
    coarser = np.maximum(np.sqrt(cells.prod(axis=0) / most), cells.max(axis=0) / most)
    width = finest * np.maximum(coarser, 1.0)
    across, down = (grid_extent / width).astype(np.int64) + 1
    first = np.cumsum(across * down) - across * down

    along, height = _grid_positions(point, point_group, axes, corner, width)
    cell = first.take(point_group) + along.astype(np.int64)
    cell += height.astype(np.int64) * across.take(point_group)
    rank, begin = _sort_by_cell(cell, int((across * down).sum()))

    query_position = _grid_positions(query, query_group, axes, corner, width)
    grid = (first.take(query_group), across.take(query_group), down.take(query_group))
    start, count = _rows_of_cells(
        query_position, grid, begin, (radius / width[1]).take(query_group)
    )
    nonempty = np.flatnonzero(count)
    return Candidates(
        query=np.ascontiguousarray(query.T),
        point=by_axis.take(rank, axis=1),
        limit=np.full(len(query), radius**2),
        rank=rank,
        owner=nonempty // start.shape[1],
        start=start.ravel().take(nonempty),
        count=count.ravel().take(nonempty),
    )


def _extents(by_axis: FloatArray, group: IntArray, groups: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest coordinates and the extents of each group; zeros for an empty one."""
    run = run_starts(group)
    low, high = np.full((groups, len(by_axis)), np.inf), np.full((groups, len(by_axis)), -np.inf)
    np.minimum.at(low, group[run], np.minimum.reduceat(by_axis, run, axis=1).T)
    np.maximum.at(high, group[run], np.maximum.reduceat(by_axis, run, axis=1).T)
    empty = low > high
    return np.where(empty, 0.0, low), np.where(empty, 0.0, high - low)


def _sort_by_cell(cell: IntArray, cells: int) -> tuple[IntArray, IntArray]:
    """Return the points in the order of their cells, and the index at which each cell begins."""
    # A tracker starts the sooner without.
    from scipy import sparse

    # Conversion to CSR is a counting sort, twice as fast as an argsort.
    column = np.arange(len(cell))
    table = sparse.csr_array(
        (np.ones(len(cell), dtype=np.int8), (cell, column)), shape=(cells, len(cell))
    )
    return table.indices.astype(np.int64), table.indptr.astype(np.int64)


def _grid_positions(
    value: FloatArray, group: IntArray, axes: IntArray, corner: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the position of each row in its group's grid, in units of cells, shape (2, N)."""
    position = block_columns(value, np.arange(len(value)), group, axes)
    position -= corner.take(group, axis=1)
    position /= width.take(group, axis=1)
    return position


def _rows_of_cells(
    position: FloatArray,
    grid: tuple[IntArray, IntArray, IntArray],
    begin: IntArray,
    reach: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return each query's candidates: an interval of points in each of three rows of cells.

    Positions in the grid, (2, Q), are in units of cells. The grid of each query has its first cell,
    cells per row, and number of rows, (Q,). `begin` is the index at which the points of each cell
    begin, (cells + 1,), and `reach` the radius in units of a cell's height, at most one, (Q,). The
    intervals are starts and counts, (Q, 3).
    """
    (along, height), (first, across, down) = position, grid
    start, count = (np.empty((len(along), 3), dtype=np.int64) for _ in range(2))
    middle, last = np.floor(height), across - 1.0
    for column, shift in enumerate((-1.0, 0.0, 1.0)):
        row = middle + shift
        # The circle is only as wide as its chord at this distance from the centre.
        distance = np.maximum(np.maximum(row - height, height - row - 1.0) - ROUNDING, 0.0)
        half = ASPECT * np.sqrt(np.maximum(reach * reach - distance * distance, 0.0)) + ROUNDING
        first_cell = first + across * np.minimum(np.maximum(row, 0.0), down - 1.0)
        # Intervals are clipped to the grid: a query outside tests the cells at the edge in vain.
        left = first_cell + np.minimum(np.maximum(np.floor(along - half), 0.0), last)
        right = first_cell + np.minimum(np.maximum(np.floor(along + half), 0.0), last)
        start[:, column] = begin.take(left.astype(np.int64))
        count[:, column] = begin.take(right.astype(np.int64) + 1)
        count[:, column] -= start[:, column]
        count[:, column] *= (row >= 0.0) & (row < down)
    return start, count
