# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The searches' inner loops compiled by numba, an optional dependency.

The only file that imports numba, and all that is compiled stands in it: numba keeps compiled code
on disk by the file it came from and would not notice a change in another. The signatures are given,
so that compiling happens at the import and not in a scan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from .gating import CellLists

# numba's types have none of their own.
types: Any = numba.types

_FLOATS, _ROWS = types.float64[::1], types.float64[:, ::1]
_INTS, _NARROW = types.int64[::1], types.int32[::1]
# What is only read may be read-only.
_READ = types.Array(types.float64, 1, "C", readonly=True)
_READ_ROWS = types.Array(types.float64, 2, "C", readonly=True)
_READ_INTS = types.Array(types.int64, 1, "C", readonly=True)

# Cells of a cloud's grid: their width in radii, and how many there are at most along an axis.
CELL, MOST_CELLS = 1.0, 128
# In cells: what rounding may do to a place. Candidates may be too many, never too few.
ROUNDING = 1e-6


def _compiled(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    def compile_it(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True)(function)
        except RuntimeError:  # no writable place to keep it: compiled anew at every start
            return numba.njit(signature)(function)

    return compile_it


@_compiled(
    types.int64(_ROWS, _ROWS, _FLOATS, _INTS, _INTS, _INTS, _INTS, _INTS, _FLOATS),
)
def _test(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
    row: IntArray,
    place: IntArray,
    square: FloatArray,
) -> int:
    """Write the near pairs of (N, K) rows into the last three arrays; return their number."""
    found = 0
    for interval in range(len(owner)):
        one = owner[interval]
        for other in range(start[interval], start[interval] + count[interval]):
            total = 0.0
            for axis in range(query.shape[1]):
                apart = point[other, axis] - query[one, axis]
                total += apart * apart
            # Written in any case and kept if near: a branch here would be mispredicted.
            row[found], place[found], square[found] = one, other, total
            found += total <= limit[one]
    return found


def near_pairs(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the same as `plain.near_pairs`, bit for bit; (K, N) arrays in Fortran order."""
    room = int(count.sum()) + 1
    row, place = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    square = np.empty(room)
    found = _test(query.T, point.T, limit, owner, start, count, row, place, square)
    return row[:found], place[:found], square[:found]


@_compiled(types.UniTuple(_INTS, 2)(_READ_INTS, types.int64))
def _by_bin(bin_of: IntArray, bins: int) -> tuple[IntArray, IntArray]:
    """Return the rows in the order of their bins, and where each bin begins."""
    start = np.zeros(bins + 1, dtype=np.int64)
    for one in bin_of:
        start[one + 1] += 1
    for one in range(bins):
        start[one + 1] += start[one]
    following = start.copy()
    row = np.empty(len(bin_of), dtype=np.int64)
    for index, one in enumerate(bin_of):
        row[following[one]] = index
        following[one] += 1
    return row, start


@_compiled(types.UniTuple(types.int64, 2)(_READ_ROWS))
def _widest_two(cloud: FloatArray) -> tuple[int, int]:
    """Return the two axes along which (N, K) rows extend farthest."""
    first, second, most, next_most = 0, 0, -1.0, -1.0
    for axis in range(cloud.shape[1]):
        extent = cloud[:, axis].max() - cloud[:, axis].min()
        if extent > most:
            second, next_most, first, most = first, most, axis, extent
        elif extent > next_most:
            second, next_most = axis, extent
    return first, second


@_compiled(
    types.int64(
        *(_FLOATS, _NARROW, _INTS, _INTS, _READ), *(types.float64, types.float64, types.int64)
    )
)
def _draw(
    value: FloatArray,
    near: npt.NDArray[np.int32],
    of_group: IntArray,
    slot: IntArray,
    weight: FloatArray,
    mu: float,
    offset: float,
    most: int,
) -> int:
    """Draw the pairs of one query as `kernel_thinning.drawn` does; return how many are kept.

    The kept ones are moved to the front. `slot` is as long as `weight`, and zero before and after.
    """
    found = value.copy()
    for pair in range(len(near)):
        slot[near[pair]] = pair + 1
    scale = most / mu if mu > 0.0 else 0.0
    running, passed, kept, left = 0.0, 0, 0, len(near)
    for point in of_group:  # ascending, whatever the order in which pairs were found
        if slot[point] == 0:
            continue
        running += found[slot[point] - 1] * weight[point] * scale
        slot[point] = 0
        left -= 1
        teeth = min(max(math.ceil(running - offset), 0), most) if left else most
        if teeth > passed:
            value[kept] = (teeth - passed) * mu / (most * weight[point])
            near[kept] = point
            kept, passed = kept + 1, teeth
    return kept


@_compiled(
    types.Tuple((_FLOATS, _NARROW, _NARROW, _FLOATS))(
        *(_READ_ROWS, _READ_INTS, _READ_INTS),
        *(types.Array(types.float64, 3, "C", readonly=True), _READ_INTS, _READ_INTS, _READ),
        *(_READ_INTS, _READ_ROWS, types.int64, types.float64, _READ, types.int64),
    )
)
def kernel_within_groups(
    query: FloatArray,
    query_group: IntArray,
    query_mode: IntArray,
    point: FloatArray,
    point_group: IntArray,
    point_mode: IntArray,
    weight: FloatArray,
    motion_of: IntArray,
    density: FloatArray,
    groups: int,
    radius: float,
    comb: FloatArray,
    most: int,
) -> tuple[FloatArray, npt.NDArray[np.int32], npt.NDArray[np.int32], FloatArray]:
    """Evaluate a Gaussian kernel between near rows of one group, and its sums over the points.

    Group by group and motion by motion, each cloud on a grid over the two axes where it is widest:
    no sorting, and no stranger is looked at.

    Parameters
    ----------
    query : array of shape (Q, K)
        Whitened.
    query_group, query_mode : int arrays of shape (Q,)
        Groups from 0.
    point : array of shape (motions, P, K)
        Whitened, as each motion moves them.
    point_group, point_mode : int arrays of shape (P,)
    weight : array of shape (P,)
    motion_of : int array of shape (O,)
        By flat mode of the query.
    density : array of shape (O, O)
        The kernel at its peak, from a point's mode to a query's.
    groups : int
    radius : float
    comb : array of shape (Q,)
        Where each query's comb begins, see `resampling.comb`.
    most : int
        Pairs kept of a query at the most, drawn as by `kernel_thinning.drawn`.

    Returns
    -------
    value : array of shape (pairs,)
        Query by query.
    point : int array of shape (pairs,)
    start : int array of shape (Q + 1,)
        Where each query's pairs begin.
    mu : array of shape (Q,)
        Sum of value times weight over every query's pairs.
    """
    query_row, query_start = _by_bin(query_group, groups)
    point_row, point_start = _by_bin(point_group, groups)
    start = np.zeros(len(query) + 1, dtype=np.int32)
    begin = np.zeros(len(query), dtype=np.int64)
    mu = np.zeros(len(query))
    value = np.empty(8 * len(query) + 64)
    near = np.empty(len(value), dtype=np.int32)
    slot = np.zeros(len(weight), dtype=np.int64)
    reach = radius + ROUNDING
    found = 0
    for group in range(groups):
        own = query_row[query_start[group] : query_start[group + 1]]
        of_group = point_row[point_start[group] : point_start[group + 1]]
        if len(own) == 0 or len(of_group) == 0:
            continue
        for motion in range(len(point)):
            mine = own[motion_of[query_mode[own]] == motion]
            if len(mine) == 0:
                continue
            cloud = point[motion][of_group]
            x, y = _widest_two(cloud)
            low_x, low_y = cloud[:, x].min(), cloud[:, y].min()
            wide_x, wide_y = cloud[:, x].max() - low_x, cloud[:, y].max() - low_y
            width = max(CELL * radius, max(wide_x, wide_y) / (MOST_CELLS - 1))
            across, down = int(wide_x / width) + 1, int(wide_y / width) + 1
            # Clamped, for here a place outside would be a place in somebody else's memory.
            strip = ((cloud[:, y] - low_y) / width).astype(np.int64)
            strip = np.minimum(np.maximum(strip, 0), down - 1)
            cell = ((cloud[:, x] - low_x) / width).astype(np.int64)
            cell = np.minimum(np.maximum(cell, 0), across - 1)
            order, cell_start = _by_bin(strip * across + cell, across * down)
            cloud, row = cloud[order], of_group[order]
            cloud_mode, cloud_weight = point_mode[row], weight[row]
            for one in mine:
                begin[one] = found
                if found + len(row) >= len(value):
                    value = np.concatenate((value, np.empty(len(value) + len(row) + 1)))
                    near = np.concatenate((near, np.empty(len(value) - len(near), np.int32)))
                at_x, at_y = query[one, x] - low_x, query[one, y] - low_y
                first = max(math.floor((at_y - reach) / width), 0)
                last = min(math.floor((at_y + reach) / width), down - 1)
                for line in range(first, last + 1):
                    # Of a circle, a strip so far from its centre holds no more than a chord.
                    apart = max(line * width - at_y, at_y - (line + 1) * width, 0.0)
                    half = math.sqrt(max(reach * reach - apart * apart, 0.0)) + ROUNDING
                    left = max(math.floor((at_x - half) / width), 0)
                    right = min(math.floor((at_x + half) / width), across - 1)
                    if left > right:
                        continue
                    line_start = line * across
                    for other in range(
                        cell_start[line_start + left], cell_start[line_start + right + 1]
                    ):
                        square = 0.0
                        for axis in range(query.shape[1]):
                            offset = cloud[other, axis] - query[one, axis]
                            square += offset * offset
                        # Written in any case: see `_test`.
                        value[found], near[found] = square, other
                        found += square <= radius * radius
                share = density[:, query_mode[one]]
                for pair in range(begin[one], found):
                    other = near[pair]
                    value[pair] = math.exp(-0.5 * value[pair]) * share[cloud_mode[other]]
                    near[pair] = row[other]
                    mu[one] += value[pair] * cloud_weight[other]
                if found - begin[one] > most:
                    own_pairs = slice(begin[one], found)
                    found = begin[one] + _draw(
                        *(value[own_pairs], near[own_pairs], of_group, slot, weight),
                        *(mu[one], comb[one], most),
                    )
                start[one + 1] = found - begin[one]
    # From the order of groups to that of queries.
    for one in range(len(query)):
        start[one + 1] += start[one]
    sorted_value = np.empty(found)
    sorted_near = np.empty(found, dtype=np.int32)
    for one in range(len(query)):
        for pair in range(start[one + 1] - start[one]):
            sorted_value[start[one] + pair] = value[begin[one] + pair]
            sorted_near[start[one] + pair] = near[begin[one] + pair]
    return sorted_value, sorted_near, start, mu


@_compiled(
    types.int64(
        *(_READ_INTS, _READ_INTS, _READ, _READ, _READ_INTS, _READ_ROWS),
        *(types.float64, types.float64, _INTS, _INTS, _FLOATS),
    )
)
def _gate(
    start: IntArray,
    detection: IntArray,
    listed_range: FloatArray,
    listed_azimuth: FloatArray,
    cell: IntArray,
    predicted: FloatArray,
    sigmas: float,
    azimuth_gate: float,
    row: IntArray,
    column: IntArray,
    square: FloatArray,
) -> int:
    """Write the pairs within the gate into the last three arrays; return their number."""
    found = 0
    for one in range(len(cell)):
        away, azimuth = predicted[one, 0], predicted[one, 1]
        for slot in range(start[cell[one]], start[cell[one] + 1]):
            range_error = listed_range[slot] - away
            azimuth_error = listed_azimuth[slot] - azimuth
            row[found], column[found] = one, detection[slot]
            square[found] = range_error * range_error + azimuth_error * azimuth_error
            found += (
                (square[found] <= sigmas * sigmas)
                & (azimuth_error >= -azimuth_gate)
                & (azimuth_error < azimuth_gate)
            )
    return found


def near_detections(
    lists: CellLists, predicted: FloatArray, std: FloatArray, sigmas: float, azimuth_gate: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the same as `gating.near_detections`, bit for bit."""
    cell = lists.cell_of(predicted)
    room = int(np.diff(lists.start).take(cell).sum()) + 1
    row, column = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    square = np.empty(room)
    listed_range, listed_azimuth, turned_gate = lists.in_sigmas(std, azimuth_gate)
    found = _gate(
        *(lists.start, lists.detection, listed_range, listed_azimuth, cell, predicted / std),
        *(sigmas, turned_gate, row, column, square),
    )
    return row[:found], column[:found], square[:found]
