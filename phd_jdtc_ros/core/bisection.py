"""Places in ascending vectors, for compiled functions.

They are those of `numpy.searchsorted`, which takes several times as long to compile.
"""

from __future__ import annotations

from .arrays import FloatArray, IntArray
from .compilation import inner


@inner
def count_below(ascending: FloatArray | IntArray, value: float) -> int:
    """Return how many entries of an ascending vector are below a value."""
    low, high = 0, len(ascending)
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low
