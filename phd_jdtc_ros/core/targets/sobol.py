"""Sobol points: sets that fill the unit cube more evenly than independent points do."""

from __future__ import annotations

from functools import lru_cache

from ..arrays import FloatArray, read_only

BITS = 30


@lru_cache(maxsize=8)
def sobol_points(dimension: int, count: int) -> FloatArray:
    """Return the first points of the sequence; unscrambled, so the first is the origin.

    Parameters
    ----------
    count : int
        A power of two, at most 2^30.

    Returns
    -------
    array of shape (count, dimension)
        In [0, 1), in the order of the Gray code.

    Raises
    ------
    ValueError
        If the count is not such a power of two.
    """
    if count < 1 or count & (count - 1) or count > 2**BITS:
        raise ValueError(f"count: {count} given, must be a power of two, at most 2^{BITS}")
    # This is imported here because only the particle engine needs it: it takes half a second.
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, scramble=False, bits=BITS).random(count)
    found: FloatArray = read_only(points)
    return found
