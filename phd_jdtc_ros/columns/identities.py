"""Mode A codes and Mode S addresses of detections in messages."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import UNKNOWN

# Marks an unknown identity in a message, whose unsigned columns cannot hold -1.
NONE = 2**32 - 1
# First value above the allowed ones, and the values that mark an unknown identity: aircraft may
# reply with the code 0000, but no transponder has an address of zeros or of ones (ICAO Annex 10,
# volume III, chapter 9).
CODES = (2**12, ())
ADDRESSES = (2**24, (0, 2**24 - 1))
# Detection types have three bits; type 0 is unknown.
DETECTION_TYPES = (2**3, (0,))


def read(
    column: FloatArray | None, kept: npt.NDArray[np.bool_], numbers: tuple[int, tuple[int, ...]]
) -> tuple[IntArray | None, int]:
    """Decode the codes or addresses of the kept points, and count the impossible ones.

    Returns `UNKNOWN` for `NONE`, NaN and the second part of `numbers`, which are `CODES`,
    `ADDRESSES` or `DETECTION_TYPES`; None without a column, which is as received.
    """
    if column is None:
        return None, 0
    end, none = numbers
    values = column[kept]
    known = ~(np.isnan(values) | np.isin(values, (NONE, *none)))
    # Some drivers send all columns in single precision, which rounds `NONE` to 2^32.
    known &= values != float(NONE + 1)
    usable = known & (values >= 0) & (values < end) & (values == np.floor(values))
    identity = np.where(usable, np.where(usable, values, 0.0).astype(np.int64), UNKNOWN)
    return identity, int(np.count_nonzero(known & ~usable))


def encode(identity: IntArray | None, count: int) -> npt.NDArray[np.uint32]:
    """Return the column of a message, all `NONE` if there are no identities."""
    known = np.full(count, UNKNOWN) if identity is None else identity
    return np.where(known == UNKNOWN, NONE, known).astype(np.uint32)
