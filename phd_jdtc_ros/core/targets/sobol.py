"""Sobol points: sets that fill the unit cube more evenly than independent points do."""

from __future__ import annotations

from functools import lru_cache

from ..arrays import FloatArray, read_only

BITS = 30


@lru_cache(maxsize=8)
def sobol_points(dimension: int, count: int) -> FloatArray:
    """Return the first points of the sequence, (count, dimension), in the order of the Gray code.

    They are unscrambled, so that the first is the origin, and in [0, 1). Raise `ValueError` if the
    count is not a power of two, at most 2^30.
    """
    if count < 1 or count & (count - 1) or count > 2**BITS:
        raise ValueError(f"count: {count} given, must be a power of two, at most 2^{BITS}")
    # This is imported here because only the particle engine needs it: it takes half a second.
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, scramble=False, bits=BITS).random(count)
    found: FloatArray = read_only(points)
    return found
