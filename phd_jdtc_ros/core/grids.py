"""Candidates among the points of one group: a grid of cells for the cloud of every group.

Where pairs must be of one group, as of one target's origin, the clouds are many and small. Each
has a grid of its own over the two axes along which it is widest, so what a query may reach is
looked up in a table of cells: no coordinate is sorted or searched for.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .chunking import Pairs
from .neighbours import ROUNDING, Candidates, columns_of, near_chunks
from .types import FloatArray, IntArray, run_starts

# Cells are as high as the radius and so many times as slender: what a row of them holds beside the
# circle is tested in vain.
SLENDER = 3
# Far-spread clouds get larger cells, so that there are no more than this many to a point.
CELLS_A_POINT = 8


def within_groups(
    query: FloatArray,
    query_group: IntArray,
    point: FloatArray,
    point_group: IntArray,
    radius: float,
) -> Iterator[Pairs]:
    """Yield in chunks every (query, point) pair of one group at most `radius` apart.

    Parameters
    ----------
    query : array of shape (Q, K)
        K at least 2; not empty, like the points.
    query_group : int array of shape (Q,)
        From 0.
    point : array of shape (P, K)
    point_group : int array of shape (P,)
    radius : float
    """
    yield from near_chunks(grid_candidates(query, query_group, point, point_group, radius))


def grid_candidates(
    query: FloatArray,
    query_group: IntArray,
    point: FloatArray,
    point_group: IntArray,
    radius: float,
) -> Candidates:
    """Return what is to be tested; parameters as those of `within_groups`."""
    groups = 1 + int(max(query_group.max(), point_group.max()))
    low, extent = _extents(point, point_group, groups)
    order = np.argsort(-extent, axis=1, kind="stable")
    corner, wide = (np.take_along_axis(each, order[:, :2], axis=1).T for each in (low, extent))
    finest = np.array([[radius / SLENDER], [radius]])
    points = np.bincount(point_group, minlength=groups)
    area = (wide / finest).prod(axis=0) / (CELLS_A_POINT * np.maximum(points, 1))
    width = finest * np.sqrt(np.maximum(area, 1.0))
    across, down = (wide / width).astype(np.int64) + 1
    first = np.cumsum(across * down) - across * down

    along, height = _places(point, point_group, order, corner, width)
    cell = first.take(point_group) + along.astype(np.int64)
    cell += height.astype(np.int64) * across.take(point_group)
    rank = np.argsort(cell, kind="stable")
    number = np.bincount(cell, minlength=int((across * down).sum()))
    begin = np.concatenate([[0], np.cumsum(number)])

    place = _places(query, query_group, order, corner, width)
    grid = (first.take(query_group), across.take(query_group), down.take(query_group))
    start, count = _rows_of_cells(place, grid, begin, (radius / width[1]).take(query_group))
    kept = np.flatnonzero(count)
    return Candidates(
        query=columns_of(query, np.arange(len(query)), query_group, order),
        point=columns_of(point, rank, point_group[rank], order),
        limit=np.full(len(query), radius**2),
        rank=rank,
        owner=kept // start.shape[1],
        start=start.ravel()[kept],
        count=count.ravel()[kept],
    )


def _extents(point: FloatArray, group: IntArray, groups: int) -> tuple[FloatArray, FloatArray]:
    """Return each group's lowest coordinates and how far it extends; zeros where it is empty."""
    run = run_starts(group)
    by_axis = np.ascontiguousarray(point.T)
    low, high = np.full((groups, len(by_axis)), np.inf), np.full((groups, len(by_axis)), -np.inf)
    np.minimum.at(low, group[run], np.minimum.reduceat(by_axis, run, axis=1).T)
    np.maximum.at(high, group[run], np.maximum.reduceat(by_axis, run, axis=1).T)
    empty = low > high
    return np.where(empty, 0.0, low), np.where(empty, 0.0, high - low)


def _places(
    value: FloatArray, group: IntArray, order: IntArray, corner: FloatArray, width: FloatArray
) -> FloatArray:
    """Return where in its group's grid each row stands, in cells, shape (2, N)."""
    place = columns_of(value, np.arange(len(value)), group, order[:, :2])
    for axis in range(2):
        place[axis] -= corner[axis].take(group)
        place[axis] /= width[axis].take(group)
    return place


def _rows_of_cells(
    place: FloatArray,
    grid: tuple[IntArray, IntArray, IntArray],
    begin: IntArray,
    reach: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return what each query may reach: an interval of points in each of three rows of cells.

    Parameters
    ----------
    place : array of shape (2, Q)
        In cells.
    grid : tuple of int arrays of shape (Q,)
        First cell, cells in a row, and rows of the query's grid.
    begin : int array of shape (cells + 1,)
        Where the points of each cell begin.
    reach : array of shape (Q,)
        The radius in heights of a cell, at most one.

    Returns
    -------
    start, count : int arrays of shape (Q, 3)
    """
    (along, height), (first, across, down) = place, grid
    start, count = (np.zeros((len(along), 3), dtype=np.int64) for _ in range(2))
    middle = np.floor(height)
    for column, shift in enumerate((-1.0, 0.0, 1.0)):
        row = middle + shift
        # Of a circle, a row so far from its centre holds no more than a chord.
        apart = np.maximum(np.maximum(row - height, height - row - 1.0) - ROUNDING, 0.0)
        half = SLENDER * np.sqrt(np.maximum(reach * reach - apart * apart, 0.0)) + ROUNDING
        left = np.maximum(np.floor(along - half), 0.0)
        right = np.minimum(np.floor(along + half), across - 1.0)
        seen = np.flatnonzero((row >= 0.0) & (row < down) & (left <= right))
        begins = first.take(seen) + row.take(seen).astype(np.int64) * across.take(seen)
        own = begin.take(begins + left.take(seen).astype(np.int64))
        start[seen, column] = own
        count[seen, column] = begin.take(begins + right.take(seen).astype(np.int64) + 1) - own
    return start, count
