# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""All pairs of points closer than a radius, by sorting and sweeping.

A tracking filter's clouds, whitened by a kernel's noise, are wide in two coordinates and a few
units wide in the others, so a search over two coordinates finds little but true neighbours. Which
two differs from block to block: mostly the positions, but a spawned turn rate is told apart best.
The second coordinate is cut into strips as wide as the radius, points are sorted by (block, strip,
first coordinate), and each query looks up one interval in each of the strips it reaches. What the
intervals hold are its candidates, which are tested chunk by chunk.

The test is the inner loop and there are two of it, `near_pairs` here and in `neighbours_numba`,
which add the same numbers in the same order and so return the same bits. So do the two that gate
detections. Where pairs must be of one group, as of one target's origin, `grids` takes the place of
the sweep; the compiled `kernel_within_groups` evaluates the kernel as well, and its values differ
in their last digits. Compiled code is used where numba is installed; the environment variable
``PHD_JDTC_KERNELS`` says otherwise: ``numpy`` or ``numba``, by default ``auto``.
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

# Axes are chosen on so many queries and points, and on one more of so many.
SAMPLE, SPARSE = 24, 128
# In strips: what rounding may do to a place. Candidates may be too many, never too few.
ROUNDING = 1e-6
VARIABLE = "PHD_JDTC_KERNELS"


@dataclass(frozen=True)
class Candidates:
    """What a search leaves to be tested: intervals of the sorted points.

    Parameters
    ----------
    query, point : arrays of shape (K, Q) and (K, P)
        Coordinates by axis, each block's most selective ones first; points in sorted order.
    limit : array of shape (Q,)
        Square radius of each query.
    rank : int array of shape (P,)
        Which point stands at each place of the sorted order.
    owner : int array of shape (I,)
        The query of each interval, ascending.
    start, count : int arrays of shape (I,)
        Interval i holds the places ``start[i]`` to ``start[i] + count[i]``.
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


def near_chunks(found: Candidates) -> Iterator[Pairs]:
    """Test candidates chunk by chunk; yield, in order, the pairs that are truly near."""
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

    Parameters are those of `Candidates`; the intervals may be some of them.
    """
    row, place = expand(owner, start, count)
    square = np.zeros(len(row))
    # The searched axes leave few false candidates, so the first look is at three axes at once.
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
    """Who tests candidates.

    Parameters
    ----------
    name : str
    near_pairs : callable
        As the one here.
    layout : "C" or "F"
        Memory order of the coordinates, (K, N): numpy gathers one axis after the other, compiled
        code reads all of a point.
    near_detections : callable
        As that of `gating`.
    kernel_within_groups : callable or None
        That of `neighbours_numba`; where there is none, `grids` finds the pairs.
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
    """Return the backend of this name; ``auto`` is numba where that is installed, or else numpy.

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
