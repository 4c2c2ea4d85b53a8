"""Sobol points: sets that fill the unit cube more evenly than independent points do.

The points are those of `scipy.stats.qmc.Sobol` without scrambling, bit for bit. Importing that
module takes half a second, which would be a third of a live node's start.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import FloatArray, read_only

BITS = 30
# For dimension 1, 2 and so on: the primitive polynomial modulo two as a number, highest power
# first, and the first direction integers. Dimension 0, van der Corput's sequence, has none.
_POLYNOMIALS = (3, 7, 11, 13, 19, 25)
_FIRST = ((1,), (1, 3), (1, 3, 1), (1, 1, 1), (1, 1, 3, 3), (1, 3, 5, 13))
MOST_DIMENSIONS = 1 + len(_FIRST)


@lru_cache(maxsize=8)
def sobol_points(dimension: int, count: int) -> FloatArray:
    """Return the first points of the sequence; unscrambled, so the first is the origin.

    Parameters
    ----------
    dimension : int
        At most `MOST_DIMENSIONS`.
    count : int
        A power of two, at most 2^30.

    Returns
    -------
    array of shape (count, dimension)
        In [0, 1), in the order of the Gray code.

    Raises
    ------
    ValueError
        If either is out of bounds.

    References
    ----------
    Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM
    Journal on Scientific Computing 30(5), 2008: the direction numbers, and Eqs. (2) and (3).
    """
    if not 1 <= dimension <= MOST_DIMENSIONS:
        raise ValueError(f"dimension: {dimension} given, must be from 1 to {MOST_DIMENSIONS}")
    if count < 1 or count & (count - 1) or count > 2**BITS:
        raise ValueError(f"count: {count} given, must be a power of two, at most 2^{BITS}")
    place = np.arange(count)
    gray = place ^ (place >> 1)
    number = np.zeros((count, dimension), dtype=np.int64)
    for axis in range(dimension):
        for bit, direction in enumerate(_directions(axis)[: count.bit_length() - 1]):
            number[:, axis] ^= ((gray >> bit) & 1) * direction
    found: FloatArray = read_only(number * 2.0**-BITS)
    return found


def _directions(axis: int) -> list[int]:
    """Return the direction numbers of a dimension, as integers of `BITS` bits."""
    if axis == 0:
        return [1 << (BITS - 1 - bit) for bit in range(BITS)]
    polynomial, integers = _POLYNOMIALS[axis - 1], list(_FIRST[axis - 1])
    degree = polynomial.bit_length() - 1
    for _ in range(degree, BITS):
        following = integers[-degree] ^ (integers[-degree] << degree)
        for back in range(1, degree):
            following ^= (polynomial >> (degree - back) & 1) * (integers[-back] << back)
        integers.append(following)
    return [integer << (BITS - 1 - bit) for bit, integer in enumerate(integers)]
