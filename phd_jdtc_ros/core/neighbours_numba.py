"""The neighbour search's inner loop compiled by numba, an optional dependency.

The only file that imports numba, and all that is compiled stands in it: numba keeps compiled code
on disk by the file it came from and would not notice a change in another. The signature is given,
so that compiling happens at the import and not in a scan.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from .types import FloatArray, IntArray

_ROWS, _FLOATS, _INTS = "float64[:, ::1]", "float64[::1]", "int64[::1]"
_INTERVALS, _FOUND = f"{_INTS}, {_INTS}, {_INTS}", f"{_INTS}, {_INTS}, {_FLOATS}"


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


def _compile() -> Any:
    signature = f"int64({_ROWS}, {_ROWS}, {_FLOATS}, {_INTERVALS}, {_FOUND})"
    try:
        return numba.njit(signature, cache=True)(_test)
    except RuntimeError:  # no writable place to keep it: compiled anew at every start
        return numba.njit(signature)(_test)


_compiled = _compile()


def near_pairs(
    query: FloatArray,
    point: FloatArray,
    limit: FloatArray,
    owner: IntArray,
    start: IntArray,
    count: IntArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Do what `neighbours.near_pairs` does, to the bit; (K, N) arrays in Fortran order."""
    room = int(count.sum()) + 1
    row, place = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    square = np.empty(room)
    found = _compiled(query.T, point.T, limit, owner, start, count, row, place, square)
    return row[:found], place[:found], square[:found]
