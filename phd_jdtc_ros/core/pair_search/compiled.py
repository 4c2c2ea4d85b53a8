# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The inner loops of the searches, compiled by numba, an optional dependency.

Only this file imports numba, and all compiled code is in it, because numba caches compiled code on
disk by source file and does not notice a change in another file. Signatures are given, so that
compilation happens at import and not during a scan.
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

# numba ships no type information.
types: Any = numba.types

_FLOATS, _ROWS = types.float64[::1], types.float64[:, ::1]
_INTS, _NARROW = types.int64[::1], types.int32[::1]
# Inputs may be read-only arrays.
_READ = types.Array(types.float64, 1, "C", readonly=True)
_READ_ROWS = types.Array(types.float64, 2, "C", readonly=True)
_READ_INTS = types.Array(types.int64, 1, "C", readonly=True)

# Grid of a group's points: width of a cell in radii, and the largest number of cells along an axis.
CELL, MAX_CELLS = 1.0, 128
# Bound of the rounding error of a place, in cells. There may be too many candidates, never too few.
ROUNDING = 1e-6


def _compiled(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    def compile_it(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True)(function)
        except RuntimeError:  # no writable cache directory: compiled again at every start
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
        index = owner[interval]
        for other in range(start[interval], start[interval] + count[interval]):
            total = 0.0
            for axis in range(query.shape[1]):
                apart = point[other, axis] - query[index, axis]
                total += apart * apart
            # Written in any case and kept if near: a branch here would be mispredicted.
            row[found], place[found], square[found] = index, other, total
            found += total <= limit[index]
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
    """Return the rows in the order of their bins, and the index at which each bin begins."""
    start = np.zeros(bins + 1, dtype=np.int64)
    for number in bin_of:
        start[number + 1] += 1
    for number in range(bins):
        start[number + 1] += start[number]
    following = start.copy()
    row = np.empty(len(bin_of), dtype=np.int64)
    for index, number in enumerate(bin_of):
        row[following[number]] = index
        following[number] += 1
    return row, start


@_compiled(types.UniTuple(types.int64, 2)(_READ_ROWS))
def _widest_two(cloud: FloatArray) -> tuple[int, int]:
    """Return the two axes with the largest extents of (N, K) rows."""
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
    group_rows: IntArray,
    slot: IntArray,
    weight: FloatArray,
    mu: float,
    offset: float,
    most: int,
) -> int:
    """Thin one query's pairs as `kernel_thinning` does; return how many are kept, at the front.

    `slot` is a scratch array as long as `weight`, zero before and after.
    """
    found = value.copy()
    for pair in range(len(near)):
        slot[near[pair]] = pair + 1
    scale = most / mu if mu > 0.0 else 0.0
    running, passed, kept, left = 0.0, 0, 0, len(near)
    for point in group_rows:  # in ascending order, which the order of `near` need not be
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

    For each group and motion, the points are sorted into a grid over the two axes in which they
    extend farthest, so that only rows of one group are ever compared.

    Parameters
    ----------
    query : array of shape (Q, K)
        Whitened.
    query_group, query_mode : int arrays of shape (Q,)
        Groups from 0.
    point : array of shape (motions, P, K)
        Whitened; predicted by each motion.
    point_group, point_mode : int arrays of shape (P,)
    weight : array of shape (P,)
    motion_of : int array of shape (O,)
        Motion of each flat mode.
    density : array of shape (O, O)
        The kernel at its peak, from a point's mode to a query's.
    groups : int
    radius : float
    comb : array of shape (Q,)
        Offset of each query's comb, see `resampling.comb`.
    most : int
        At most this many pairs are kept per query, drawn as in `kernel_thinning`.

    Returns
    -------
    value : array of shape (pairs,)
        Query by query.
    point : int array of shape (pairs,)
    start : int array of shape (Q + 1,)
        Index at which each query's pairs begin.
    mu : array of shape (Q,)
        Sum of value times weight over all pairs of each query, before thinning.
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
        group_rows = point_row[point_start[group] : point_start[group + 1]]
        if len(own) == 0 or len(group_rows) == 0:
            continue
        for motion in range(len(point)):
            rows = own[motion_of[query_mode[own]] == motion]
            if len(rows) == 0:
                continue
            cloud = point[motion][group_rows]
            x, y = _widest_two(cloud)
            low_x, low_y = cloud[:, x].min(), cloud[:, y].min()
            wide_x, wide_y = cloud[:, x].max() - low_x, cloud[:, y].max() - low_y
            width = max(CELL * radius, max(wide_x, wide_y) / (MAX_CELLS - 1))
            across, down = int(wide_x / width) + 1, int(wide_y / width) + 1
            # Clamped, because compiled code does not check indices.
            strip = ((cloud[:, y] - low_y) / width).astype(np.int64)
            strip = np.minimum(np.maximum(strip, 0), down - 1)
            cell = ((cloud[:, x] - low_x) / width).astype(np.int64)
            cell = np.minimum(np.maximum(cell, 0), across - 1)
            order, cell_start = _by_bin(strip * across + cell, across * down)
            cloud, row = cloud[order], group_rows[order]
            cloud_mode, cloud_weight = point_mode[row], weight[row]
            for index in rows:
                begin[index] = found
                if found + len(row) >= len(value):
                    value = np.concatenate((value, np.empty(len(value) + len(row) + 1)))
                    near = np.concatenate((near, np.empty(len(value) - len(near), np.int32)))
                at_x, at_y = query[index, x] - low_x, query[index, y] - low_y
                first = max(math.floor((at_y - reach) / width), 0)
                last = min(math.floor((at_y + reach) / width), down - 1)
                for line in range(first, last + 1):
                    # At this distance from the centre, the circle is only as wide as its chord.
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
                            offset = cloud[other, axis] - query[index, axis]
                            square += offset * offset
                        # Written in any case: see `_test`.
                        value[found], near[found] = square, other
                        found += square <= radius * radius
                share = density[:, query_mode[index]]
                for pair in range(begin[index], found):
                    other = near[pair]
                    value[pair] = math.exp(-0.5 * value[pair]) * share[cloud_mode[other]]
                    near[pair] = row[other]
                    mu[index] += value[pair] * cloud_weight[other]
                if found - begin[index] > most:
                    own_pairs = slice(begin[index], found)
                    found = begin[index] + _draw(
                        *(value[own_pairs], near[own_pairs], group_rows, slot, weight),
                        *(mu[index], comb[index], most),
                    )
                start[index + 1] = found - begin[index]
    # Reorder from groups to queries.
    for index in range(len(query)):
        start[index + 1] += start[index]
    sorted_value = np.empty(found)
    sorted_near = np.empty(found, dtype=np.int32)
    for index in range(len(query)):
        for pair in range(start[index + 1] - start[index]):
            sorted_value[start[index] + pair] = value[begin[index] + pair]
            sorted_near[start[index] + pair] = near[begin[index] + pair]
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
    for index in range(len(cell)):
        distance, azimuth = predicted[index, 0], predicted[index, 1]
        for slot in range(start[cell[index]], start[cell[index] + 1]):
            range_error = listed_range[slot] - distance
            azimuth_error = listed_azimuth[slot] - azimuth
            row[found], column[found] = index, detection[slot]
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
    listed_range, listed_azimuth, scaled_gate = lists.in_sigmas(std, azimuth_gate)
    found = _gate(
        *(lists.start, lists.detection, listed_range, listed_azimuth, cell, predicted / std),
        *(sigmas, scaled_gate, row, column, square),
    )
    return row[:found], column[:found], square[:found]
