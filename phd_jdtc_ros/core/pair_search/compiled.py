"""The inner loops of the searches, compiled by numba; see `core.numba_loops`."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..numba_loops import compiled, read, types
from .gating import CellLists

_FLOATS, _ROWS = types.float64[::1], types.float64[:, ::1]
_INTS = types.int64[::1]
_READ, _READ_ROWS = read(types.float64, 1), read(types.float64, 2)
_READ_INTS = read(types.int64, 1)


@compiled(
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


@compiled(
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
