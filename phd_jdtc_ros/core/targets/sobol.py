"""Sobol points: sets that fill the unit cube more evenly than independent points do."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import FloatArray, read_only

BITS = 30
# A primitive polynomial over GF(2) for each axis, as the bits of its coefficients, and the odd
# numbers with which its recurrence begins. They are the first of scipy.stats.qmc, whose import
# would take a third of the start of a tracker.
AXES: tuple[tuple[int, tuple[int, ...]], ...] = (
    (1, ()),
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
)


@lru_cache(maxsize=8)
def sobol_points(dimension: int, count: int) -> FloatArray:
    """Return the first points of the sequence, (count, dimension), in the order of the Gray code.

    They are unscrambled, so that the first is the origin, and in [0, 1). Raise `ValueError` if the
    count is not a power of two, at most 2^30, or if there are more axes than `AXES` has.

    References
    ----------
    Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM
    Journal on Scientific Computing 30(5), 2008.
    """
    if count < 1 or count & (count - 1) or count > 2**BITS:
        raise ValueError(f"count: {count} given, must be a power of two, at most 2^{BITS}")
    if not 1 <= dimension <= len(AXES):
        raise ValueError(f"dimension: {dimension} given, must be from 1 to {len(AXES)}")
    doublings = count.bit_length() - 1
    directions = [
        _directions(polynomial, initial, doublings) for polynomial, initial in AXES[:dimension]
    ]
    points = np.zeros((count, dimension), dtype=np.int64)
    for bit, direction in enumerate(zip(*directions, strict=True)):
        # The Gray code of the next 2^bit numbers is that of the numbers before in reverse order,
        # with one bit more.
        half = 1 << bit
        points[half : 2 * half] = points[:half][::-1] ^ np.array(direction)
    scaled: FloatArray = read_only(points * 2.0**-BITS)
    return scaled


def _directions(polynomial: int, initial: tuple[int, ...], count: int) -> list[int]:
    """Return what each bit of a Gray code adds to a coordinate, in units of 2^-BITS."""
    degree = len(initial)
    odd = list(initial)
    while len(odd) < count:
        following = odd[-degree] if degree else 1
        for back in range(1, degree + 1):
            if polynomial >> (degree - back) & 1:
                following ^= odd[-back] << back
        odd.append(following)
    return [value << (BITS - 1 - bit) for bit, value in enumerate(odd[:count])]
