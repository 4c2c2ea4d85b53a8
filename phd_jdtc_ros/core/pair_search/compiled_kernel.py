"""The backward kernel between rows of one group, compiled by numba.

For each group and motion, the points are sorted into a grid over the two axes in which they extend
farthest, so that only rows of one group are ever compared. Against the search of `grid` with a
compiled test, a kernel takes 0.6 to 0.7 of the time (`python -m benchmarks --part searches`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from ..numba_loops import compiled, read, types
from .rows import Points, Queries

_FLOATS, _INTS, _NARROW = types.float64[::1], types.int64[::1], types.int32[::1]
_READ, _READ_ROWS, _READ_CLOUDS = (read(types.float64, axes) for axes in (1, 2, 3))
_READ_INTS = read(types.int64, 1)
# A grid: its two axes, its corner on them, the width of its cells, its numbers of columns and
# lines, the rows in the order of their cells, and the index at which each cell begins.
_GRID = types.Tuple((*(types.int64,) * 2, *(types.float64,) * 3, *(types.int64,) * 2, _INTS, _INTS))

# Grid of a group's points: width of a cell in radii, and the largest number of cells along an axis.
CELL, MAX_CELLS = 1.0, 128
# Bound on the rounding error of a position in a grid, in cells. It may add candidates, but never
# removes one.
ROUNDING = 1e-6


def kernel_within_groups(
    queries: Queries,
    points: Points,
    motion_of: IntArray,
    density: FloatArray,
    radius: float,
    comb: FloatArray,
    most: int,
) -> tuple[FloatArray, npt.NDArray[np.int32], npt.NDArray[np.int32], FloatArray]:
    """Evaluate a Gaussian kernel between near rows of one group, and its sums over the points.

    Parameters
    ----------
    points : Points
        Not both empty.
    motion_of : int array of shape (O,)
        Motion of each flat mode.
    density : array of shape (O, O)
        The kernel at its peak, from a point's mode to a query's.
    comb : array of shape (Q,)
        Offset of each query's comb, see `resampling.comb`.
    most : int
        Largest number of pairs kept per query, selected as in `kernel_thinning`.

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
    groups = 1 + int(np.concatenate((queries.group, points.group)).max())
    value, near, begin, count, mu = _kernel(
        *queries, *points, motion_of, density, groups, radius, comb, most
    )
    return *_by_query(value, near, begin, count), mu


@compiled(types.UniTuple(_INTS, 2)(_READ_INTS, types.int64))
def _by_bin(bin_of: IntArray, bins: int) -> tuple[IntArray, IntArray]:
    """Return the rows sorted by bin, and the index at which each bin begins."""
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


@compiled(types.UniTuple(types.int64, 2)(_READ_ROWS))
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


@compiled(
    types.int64(
        *(_FLOATS, _NARROW, _INTS, _INTS, _READ), *(types.float64, types.float64, types.int64)
    )
)
def _select(
    value: FloatArray,
    near: npt.NDArray[np.int32],
    group_rows: IntArray,
    slot: IntArray,
    weight: FloatArray,
    mu: float,
    offset: float,
    most: int,
) -> int:
    """Thin one query's pairs as `kernel_thinning` does; return the number kept, at the front.

    `slot` is a scratch array of the length of `weight`, zero before and after.
    """
    found = value.copy()
    for pair in range(len(near)):
        slot[near[pair]] = pair + 1
    scale = most / mu if mu > 0.0 else 0.0
    running, passed, kept, left = 0.0, 0, 0, len(near)
    for point in group_rows:  # ascending, unlike the order of `near`
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


@compiled(_GRID(_READ_ROWS, types.float64))
def _grid(
    cloud: FloatArray, radius: float
) -> tuple[int, int, float, float, float, int, int, IntArray, IntArray]:
    """Sort (N, K) rows into cells at least as wide as the radius."""
    x, y = _widest_two(cloud)
    low_x, low_y = cloud[:, x].min(), cloud[:, y].min()
    wide_x, wide_y = cloud[:, x].max() - low_x, cloud[:, y].max() - low_y
    width = max(CELL * radius, max(wide_x, wide_y) / (MAX_CELLS - 1))
    across, down = int(wide_x / width) + 1, int(wide_y / width) + 1
    # Clamped, because compiled code has no bounds checks.
    strip = ((cloud[:, y] - low_y) / width).astype(np.int64)
    strip = np.minimum(np.maximum(strip, 0), down - 1)
    cell = ((cloud[:, x] - low_x) / width).astype(np.int64)
    cell = np.minimum(np.maximum(cell, 0), across - 1)
    order, start = _by_bin(strip * across + cell, across * down)
    return x, y, low_x, low_y, width, across, down, order, start


@compiled(types.int64(_READ, _READ_ROWS, _GRID, types.float64, _FLOATS, _NARROW))
def _near(
    query: FloatArray,
    cloud: FloatArray,
    grid: tuple[int, int, float, float, float, int, int, IntArray, IntArray],
    radius: float,
    square: FloatArray,
    place: npt.NDArray[np.int32],
) -> int:
    """Write square distances and indices of near rows of a sorted cloud; return their number."""
    x, y, low_x, low_y, width, across, down, _, start = grid
    at_x, at_y, reach = query[x] - low_x, query[y] - low_y, radius + ROUNDING
    first = max(math.floor((at_y - reach) / width), 0)
    last = min(math.floor((at_y + reach) / width), down - 1)
    found = 0
    for line in range(first, last + 1):
        # The circle is only as wide as its chord at this distance from the centre.
        apart = max(line * width - at_y, at_y - (line + 1) * width, 0.0)
        half = math.sqrt(max(reach * reach - apart * apart, 0.0)) + ROUNDING
        left = max(math.floor((at_x - half) / width), 0)
        right = min(math.floor((at_x + half) / width), across - 1)
        if left > right:
            continue
        for other in range(start[line * across + left], start[line * across + right + 1]):
            total = 0.0
            for axis in range(len(query)):
                offset = cloud[other, axis] - query[axis]
                total += offset * offset
            # Written in any case and kept if near: a branch here would be mispredicted.
            square[found], place[found] = total, other
            found += total <= radius * radius
    return found


@compiled(
    types.Tuple((_FLOATS, _NARROW, _INTS, _INTS, _FLOATS))(
        *(_READ_ROWS, _READ_INTS, _READ_INTS, _READ_CLOUDS, _READ_INTS, _READ_INTS, _READ),
        *(_READ_INTS, _READ_ROWS, types.int64, types.float64, _READ, types.int64),
    )
)
def _kernel(
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
) -> tuple[FloatArray, npt.NDArray[np.int32], IntArray, IntArray, FloatArray]:
    """Return values, points, start and number of each query's pairs, and mu, group by group.

    The parameters are the fields and parameters of `kernel_within_groups`.
    """
    query_row, query_start = _by_bin(query_group, groups)
    point_row, point_start = _by_bin(point_group, groups)
    begin, count = np.zeros(len(query), dtype=np.int64), np.zeros(len(query), dtype=np.int64)
    mu = np.zeros(len(query))
    value = np.empty(8 * len(query) + 64)
    near = np.empty(len(value), dtype=np.int32)
    slot = np.zeros(len(weight), dtype=np.int64)
    found = 0
    for group in range(groups):
        own = query_row[query_start[group] : query_start[group + 1]]
        group_rows = point_row[point_start[group] : point_start[group + 1]]
        if len(own) == 0 or len(group_rows) == 0:
            continue
        for motion in range(len(point)):
            queries = own[motion_of[query_mode[own]] == motion]
            if len(queries) == 0:
                continue
            cloud = point[motion][group_rows]
            grid = _grid(cloud, radius)
            order = grid[7]
            cloud, row = cloud[order], group_rows[order]
            row_mode, row_weight = point_mode[row], weight[row]
            for index in queries:
                if found + len(row) >= len(value):
                    value = np.concatenate((value, np.empty(len(value) + len(row) + 1)))
                    near = np.concatenate((near, np.empty(len(value) - len(near), np.int32)))
                end = found + _near(query[index], cloud, grid, radius, value[found:], near[found:])
                share = density[:, query_mode[index]]
                for pair in range(found, end):
                    other = near[pair]
                    value[pair] = math.exp(-0.5 * value[pair]) * share[row_mode[other]]
                    near[pair] = row[other]
                    mu[index] += value[pair] * row_weight[other]
                if end - found > most:
                    pairs = slice(found, end)
                    end = found + _select(
                        *(value[pairs], near[pairs], group_rows, slot, weight),
                        *(mu[index], comb[index], most),
                    )
                begin[index], count[index] = found, end - found
                found = end
    return value, near, begin, count, mu


@compiled(types.Tuple((_FLOATS, _NARROW, _NARROW))(_FLOATS, _NARROW, _INTS, _INTS))
def _by_query(
    value: FloatArray, near: npt.NDArray[np.int32], begin: IntArray, count: IntArray
) -> tuple[FloatArray, npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the pairs sorted by query, and the index at which each query begins."""
    start = np.zeros(len(begin) + 1, dtype=np.int32)
    for index in range(len(begin)):
        start[index + 1] = start[index] + count[index]
    sorted_value = np.empty(start[-1])
    sorted_near = np.empty(start[-1], dtype=np.int32)
    for index in range(len(begin)):
        for pair in range(count[index]):
            sorted_value[start[index] + pair] = value[begin[index] + pair]
            sorted_near[start[index] + pair] = near[begin[index] + pair]
    return sorted_value, sorted_near, start
