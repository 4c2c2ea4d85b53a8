"""Mode A codes and Mode S addresses of detections, as messages carry them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import UNKNOWN

# In a message, as whole numbers without a sign have no -1.
NONE = 2**32 - 1
# The first number that is none, and those within that say that there is none: an aircraft may
# answer with the code 0000, and no transponder has the address 0.
CODES = (2**12, ())
ADDRESSES = (2**24, (0,))
# Kinds of plots, in three bits; 0 is that of none.
KINDS = (2**3, (0,))


def read(
    column: FloatArray | None, kept: npt.NDArray[np.bool_], numbers: tuple[int, tuple[int, ...]]
) -> tuple[IntArray | None, int]:
    """Return the codes or addresses of the kept points, and how many cannot be such.

    Parameters
    ----------
    column : array of shape (M,) or None
        As they came; `NONE`, NaN and the numbers of `numbers` that mean none are unknown.
    kept : bool array of shape (M,)
    numbers : tuple
        `CODES` or `ADDRESSES`.

    Returns
    -------
    int array of shape (K,) or None
        `UNKNOWN` where there is none; None without a column.
    int
    """
    if column is None:
        return None, 0
    end, none = numbers
    given = column[kept]
    said = ~(np.isnan(given) | np.isin(given, (NONE, *none)))
    # Single precision, in which some drivers send whatever they have, rounds `NONE` to 2^32.
    said &= given != float(NONE + 1)
    usable = said & (given >= 0) & (given < end) & (given == np.floor(given))
    identity = np.where(usable, np.where(usable, given, 0.0).astype(np.int64), UNKNOWN)
    return identity, int(np.count_nonzero(said & ~usable))


def sent(identity: IntArray | None, count: int) -> npt.NDArray[np.uint32]:
    """Return the column of a message; all are `NONE` if there are no identities."""
    known = np.full(count, UNKNOWN) if identity is None else identity
    return np.where(known == UNKNOWN, NONE, known).astype(np.uint32)
