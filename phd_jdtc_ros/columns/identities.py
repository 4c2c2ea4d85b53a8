"""Mode A codes and Mode S addresses of detections in messages."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import UNKNOWN

# Marks an unknown identity in a message, whose unsigned columns cannot hold -1.
NONE = 2**32 - 1
# First value above the allowed ones, and the values that mark an unknown one: aircraft may reply
# with the code 0000, but no transponder has an address of zeros or of ones (ICAO Annex 10, volume
# III, chapter 9). Detection types have three bits; type 0 is unknown.
VALUES: Mapping[str, tuple[int, tuple[int, ...]]] = {
    "code": (2**12, ()),
    "address": (2**24, (0, 2**24 - 1)),
    "detection_type": (2**3, (0,)),
}


def read(
    columns: Mapping[str, FloatArray], kept: npt.NDArray[np.bool_]
) -> tuple[dict[str, IntArray], int]:
    """Decode the columns of `VALUES` that the points have, and count the impossible identities.

    The columns are as received; the results are those of the kept points, `UNKNOWN` for `NONE`, NaN
    and values that mark an unknown one. An impossible detection type is not counted.
    """
    found, impossible = {}, 0
    for name in VALUES.keys() & columns.keys():
        (end, none), values = VALUES[name], columns[name][kept]
        known = ~(np.isnan(values) | np.isin(values, (NONE, *none)))
        # Some drivers send all columns in single precision, which rounds `NONE` to 2^32.
        known &= values != float(NONE + 1)
        usable = known & (values >= 0) & (values < end) & (values == np.floor(values))
        found[name] = np.where(usable, np.where(usable, values, 0.0).astype(np.int64), UNKNOWN)
        if name != "detection_type":
            impossible += int(np.count_nonzero(known & ~usable))
    return found, impossible


def encode(identity: IntArray | None, count: int) -> npt.NDArray[np.uint32]:
    """Return the column of a message, all `NONE` if there are no identities."""
    known = np.full(count, UNKNOWN) if identity is None else identity
    return np.where(known == UNKNOWN, NONE, known).astype(np.uint32)
