"""The loops of `exact_marginals`, compiled by numba; see `core.numba_loops`.

They add the same numbers in the same order as the NumPy loops, and so return the same bits.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..numba_loops import compiled, read, types

_INTS, _FLOATS = read(types.int64, 1), read(types.float64, 1)
_WEIGHT, _STATES = types.float64[:, :, :, ::1], types.float64[:, ::1]


@compiled(_WEIGHT(_INTS, _INTS, _INTS, _FLOATS, _INTS, types.int64))
def weights(
    row: IntArray,
    column: IntArray,
    cluster: IntArray,
    odds: FloatArray,
    rows: IntArray,
    size: int,
) -> FloatArray:
    """Return the total weights of matchings, (rows + 1, 2, C, 2^M); see `exact_marginals`."""
    most, count, states = rows[0], len(rows), 1 << size
    table = np.zeros((count, most, size))
    for edge in range(len(row)):
        table[cluster[edge], row[edge], column[edge]] = odds[edge]
    weight = np.empty((most + 1, 2, count, states))
    for one in range(count):
        for state in range(states):
            weight[0, 0, one, state] = 0.0
            weight[0, 1, one, state] = 1.0
        weight[0, 0, one, 0] = 1.0
        for t in range(rows[one]):
            for way in range(2):
                for state in range(states):
                    weight[t + 1, way, one, state] = weight[t, way, one, state]
                own = rows[one] - 1 - t if way else t
                for z in range(size):
                    bit, factor = 1 << z, table[one, own, z]
                    if factor == 0.0:
                        continue
                    for base in range(0, states, 2 * bit):
                        for state in range(base, base + bit):
                            added = factor * weight[t, way, one, state]
                            weight[t + 1, way, one, state + bit] += added
    return weight


@compiled(types.UniTuple(_STATES, 2)(_WEIGHT, _INTS, _INTS, _INTS, _INTS))
def around_edges(
    weight: FloatArray, row: IntArray, column: IntArray, cluster: IntArray, rows: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the rows before and after each edge's, (E, 2^(M - 1)).

    The states before an edge are the sets without its column; the states after it are their
    complements.
    """
    count, half = len(row), weight.shape[3] // 2
    earlier, later = np.empty((count, half)), np.empty((count, half))
    for edge in range(count):
        one, bit = cluster[edge], 1 << column[edge]
        before = weight[row[edge], 0, one]
        after = weight[rows[one] - 1 - row[edge], 1, one]
        place = 0
        for base in range(0, 2 * half, 2 * bit):
            for state in range(base, base + bit):
                earlier[edge, place] = before[state]
                later[edge, half - 1 - place] = after[state]
                place += 1
    return earlier, later
