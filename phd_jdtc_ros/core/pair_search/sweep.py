# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds all pairs of points closer than a radius, by sort and sweep.

Particles whitened by a kernel's noise are spread widely in two coordinates and over a few units in
the others. So a search over two coordinates finds few false candidates. Which two are best depends
on the block: mostly the positions, for spawned targets also the turn rate. The second coordinate is
cut into strips as wide as the radius, and points are sorted by (block, strip, first coordinate).
Each query looks up one interval in each strip that it reaches. The points in these intervals are
its candidates, which are tested chunk by chunk.

The test is the inner loop. There are two versions of it, `near_pairs` here and in `compiled`, which
add the same numbers in the same order and so return the same bits; the same holds for the gating of
detections. Where both points of a pair must belong to one group, such as the origin of one target,
`grid` is used instead of the sweep. The compiled `kernel_within_groups` also evaluates the kernel,
and its values differ in their last digits. Compiled code is used if numba is installed; the
environment variable ``PHD_JDTC_KERNELS`` overrides this with ``numpy`` or ``numba`` (default
``auto``).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from .gating import near_detections
from .intervals import CHUNK_PAIRS, Pairs, chunks, expand

# Sample of queries and points on which axes are chosen: this many, and one more per so many.
SAMPLE, SPARSE = 24, 128
# Bound of the rounding error of a place, in strips. There may be too many candidates, never too
# few.
ROUNDING = 1e-6
VARIABLE = "PHD_JDTC_KERNELS"


@dataclass(frozen=True)
class Candidates:
    """The candidates of a search: intervals of the sorted points, still to be tested.

    Parameters
    ----------
    query, point : arrays of shape (K, Q) and (K, P)
        Coordinates by axis, each block's most selective ones first; points in sorted order.
    limit : array of shape (Q,)
        Square radius of each query.
    rank : int array of shape (P,)
        The point at each place of the sorted order.
    owner : int array of shape (I,)
        The query of each interval, ascending.
    start, count : int arrays of shape (I,)
        Interval i has the places from ``start[i]`` to ``start[i] + count[i]``, the last excluded.
    """

    query: FloatArray
    point: FloatArray
    limit: FloatArray
    rank: IntArray
    owner: IntArray
    start: IntArray
    count: IntArray


def candidates(
    query: FloatArray,
    query_block: IntArray,
    point: FloatArray,
    point_block: IntArray,
    radius: float | FloatArray,
) -> Candidates:
    """Return the candidates for all (query, point) pairs of one block within a radius.

    Their number, ``count.sum()``, determines the cost of a search.

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
        empty = np.zeros(0, dtype=np.int64)
        return Candidates(query.T, point.T, reach, empty, empty, empty, empty)
    blocks = int(max(query_block.max(), point_block.max())) + 1
    widest = float(reach.max())
    order = _selective_axes(query, query_block, point, point_block, widest, blocks)
    first, second = _columns(point, np.arange(len(point)), point_block, order[:, :2])
    low = float(first.min()) - 2.0 * widest, float(second.min())
    # Strips are as wide as the mean radius; larger radii reach beyond the neighbouring strips.
    width = max(float(reach.mean()), widest / 3.0) * (1.0 + ROUNDING)
    beyond = int(np.ceil(widest / width))
    # All strips of all blocks are placed one after the other on a line, with gaps between them that
    # are longer than any interval.
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
    # Looked up in sorted order, so that memory is read in order.
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
    """Return each query's interval of candidates in each strip that it may reach.

    Parameters
    ----------
    key : array of shape (P,)
        The points' places on the line of all strips, ascending.
    centre, above, radius : arrays of shape (M,)
        The queries' places on that line, their offsets within their strips and their radii, the
        latter two in units of a strip's width.
    width, span : float
        Width of a strip, and its length on the line.
    beyond : int
        Number of strips reached to either side.

    Returns
    -------
    int array of shape (2, 2 beyond + 1, M)
        Start and length.
    """
    found = np.empty((2, 2 * beyond + 1, len(centre)), dtype=np.int64)
    rounding = 4.0 * np.spacing(key[-1] + span)
    for shift in range(-beyond, beyond + 1):
        # At this distance from the centre, the circle is only as wide as its chord.
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
    columns = np.empty((axes.shape[1], len(row)), order=BACKEND.layout)
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
    """Return the axes of each block, the two most selective ones first; shape (blocks, K).

    They are the two axes that together leave the fewest pairs of a small, regular sample. The
    search is exact for any order of axes; only its cost depends on the order.
    """
    size = query.shape[1]
    order = np.tile(np.arange(size), (blocks, 1))
    for block in range(blocks):
        own, others = np.flatnonzero(query_block == block), np.flatnonzero(point_block == block)
        if len(own) == 0 or len(others) == 0:
            continue
        # With many targets, pairs that are near in two axes are rare, so the sample grows.
        some, rest = (
            coordinates[rows[:: max(1, len(rows) // (SAMPLE + len(rows) // SPARSE))]].T
            for coordinates, rows in ((query, own), (point, others))
        )
        near = (np.abs(some[:, :, None] - rest[:, None]) <= radius).reshape(size, -1)
        indicator = near.astype(np.float32)  # counts are exact, and products fast
        together = (indicator @ indicator.T).astype(np.float64)
        alone = together.diagonal()
        # The count of pairs near in both axes is small and noisy, so the count expected of
        # independent axes is added.
        left = together + np.outer(alone, alone) / near.shape[1]
        np.fill_diagonal(left, np.inf)
        best = divmod(int(left.argmin()), size)
        order[block] = [*best, *(axis for axis in range(size) if axis not in best)]
    return order


def near_chunks(found: Candidates) -> Iterator[Pairs]:
    """Test candidates chunk by chunk; yield the near pairs in order."""
    for part in chunks(found.count, CHUNK_PAIRS):
        owner, start, count = found.owner[part], found.start[part], found.count[part]
        query, place, square = BACKEND.near_pairs(
            found.query, found.point, found.limit, owner, start, count
        )
        yield Pairs(query, found.rank.take(place), square)


def near_pairs(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the query, the point's place and the square distance of all near pairs.

    Parameters are those of `Candidates`; the intervals may be a part of them.
    """
    row, place = expand(owner, start, count)
    square = np.zeros(len(row))
    # Candidates are near in two axes already, so the first test adds a third at once.
    for axes in (range(min(3, len(query))), range(3, len(query))):
        for axis in axes:
            apart = point[axis].take(place)
            apart -= query[axis].take(row)
            apart *= apart
            square += apart
        near = np.flatnonzero(square <= limit.take(row))
        row, place, square = row.take(near), place.take(near), square.take(near)
    return row, place, square


class Backend(NamedTuple):
    """The implementation of the inner loops.

    Parameters
    ----------
    name : str
    near_pairs : callable
        Same contract as `near_pairs`.
    layout : "C" or "F"
        Memory order of the coordinates, shape (K, N): numpy gathers axis by axis, compiled code
        reads all coordinates of a point.
    near_detections : callable
        Same contract as `gating.near_detections`.
    kernel_within_groups : callable or None
        `compiled.kernel_within_groups`; if None, `grid` finds the pairs.
    """

    name: str
    near_pairs: Callable[
        [FloatArray, FloatArray, FloatArray, IntArray, IntArray, IntArray],
        tuple[IntArray, IntArray, FloatArray],
    ]
    layout: Literal["C", "F"]
    near_detections: Callable[..., tuple[IntArray, IntArray, FloatArray]]
    kernel_within_groups: Callable[..., tuple[FloatArray, Any, Any, FloatArray]] | None


NUMPY = Backend("numpy", near_pairs, "C", near_detections, None)


def backend(wanted: str) -> Backend:
    """Return the backend of this name; ``auto`` is numba if it is installed, and numpy if not.

    Raises
    ------
    ValueError
        If there is no such backend.
    ImportError
        If numba is asked for and not installed.
    """
    if wanted not in ("auto", "numpy", "numba"):
        raise ValueError(f"{VARIABLE}: {wanted!r} given, must be auto, numpy or numba")
    if wanted == "numpy":
        return NUMPY
    try:
        from . import compiled
    except ImportError:
        if wanted == "numba":
            raise
        return NUMPY
    return Backend(
        "numba", compiled.near_pairs, "F", compiled.near_detections, compiled.kernel_within_groups
    )


BACKEND = backend(os.environ.get(VARIABLE, "auto"))
