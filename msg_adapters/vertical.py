"""Heights of estimates as messages with three axes have them, and as people read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import UNKNOWN, Estimates

# Metres: flight levels are hundreds of feet.
FLIGHT_LEVEL = 30.48


class Vertical(NamedTuple):
    """Heights and climb rates of T targets.

    Parameters
    ----------
    known : bool array of shape (T,)
    state : array of shape (T, 2)
        Metres and metres per second; 0 where unknown.
    covariance : array of shape (T, 2, 2)
        0 where unknown.
    """

    known: npt.NDArray[np.bool_]
    state: FloatArray
    covariance: FloatArray


def of(estimates: Estimates) -> Vertical:
    """Return the heights of estimates, none known where no radar reports any."""
    count, found = len(estimates), estimates.attributes
    if found is None:
        return Vertical(np.zeros(count, np.bool_), np.zeros((count, 2)), np.zeros((count, 2, 2)))
    known = np.isfinite(found.height[:, 0])
    return Vertical(known, np.nan_to_num(found.height), np.nan_to_num(found.height_covariance))


def words(estimates: Estimates, datum: float = 0.0) -> list[str]:
    """Return flight level and code, or address without a code, of each target; empty if unknown.

    `datum` is the height of the world's zero, metres, as flight levels count it.
    """
    found = estimates.attributes
    if found is None:
        return [""] * len(estimates)
    return [
        " ".join(part for part in (_level(datum + height), _identity(code, address)) if part)
        for height, code, address in zip(
            found.height[:, 0].tolist(), found.code.tolist(), found.address.tolist(), strict=True
        )
    ]


def flight_level(height: float) -> int | None:
    """Return the flight level of a height from the zero of the standard atmosphere, metres."""
    return round(height / FLIGHT_LEVEL) if np.isfinite(height) else None


def _level(height: float) -> str:
    level = flight_level(height)
    return "" if level is None else f"FL{level:03d}"


def _identity(code: int, address: int) -> str:
    """Return a code in octal digits, else an address in hexadecimal ones."""
    if code != UNKNOWN:
        return f"{code:04o}"
    return f"{address:06X}" if address != UNKNOWN else ""
