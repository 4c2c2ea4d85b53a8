"""Heights of estimates in messages with three axes, and as text."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import UNKNOWN, Estimates

# A flight level is 100 ft, in metres.
FLIGHT_LEVEL = 30.48


class Vertical(NamedTuple):
    """Heights and climb rates of T targets."""

    known: npt.NDArray[np.bool_]  # True where a target's height is known, (T,)
    state: FloatArray  # Metres and metres per second, (T, 2); 0 if unknown
    covariance: FloatArray  # (T, 2, 2); 0 if unknown


def of(estimates: Estimates) -> Vertical:
    """Return the heights of estimates, all unknown if no radar reports heights."""
    found = estimates.known_attributes
    known = np.isfinite(found.height[:, 0])
    return Vertical(known, states(estimates), known_or_zero(found.height_covariance))


def states(estimates: Estimates) -> FloatArray:
    """Return heights and climb rates, metres and metres per second, (T, 2); 0 if unknown."""
    found = estimates.attributes
    return np.zeros((len(estimates), 2)) if found is None else known_or_zero(found.height)


def known_or_zero(values: FloatArray) -> FloatArray:
    """Return values with zeros where they are unknown."""
    return np.where(np.isfinite(values), values, 0.0)


def words(estimates: Estimates, datum: float = 0.0) -> list[str]:
    """Return the height and the code, or else the address, of each target; empty if unknown.

    Reported heights are flight levels, and those of states in space are in metres.

    `datum` is the height of the world's zero in the scale of flight levels, metres.
    """
    if estimates.attributes is None:
        return [""] * len(estimates)
    return [
        " ".join(filter(None, (_text(estimates, datum + height), code or address)))
        for height, (code, address) in zip(
            estimates.known_attributes.height[:, 0].tolist(), identities(estimates), strict=True
        )
    ]


def _text(estimates: Estimates, height: float) -> str:
    """Return a height as text: geometric in space, in metres, and otherwise a flight level."""
    if estimates.space.vertical:
        return f"{height:.0f} m" if np.isfinite(height) else ""
    return _level(height)


def flight_level(height: float) -> int | None:
    """Return the flight level of a height in the standard atmosphere, metres."""
    return round(height / FLIGHT_LEVEL) if np.isfinite(height) else None


def _level(height: float) -> str:
    level = flight_level(height)
    return "" if level is None else f"FL{'-' * (level < 0)}{abs(level):03d}"


def identities(estimates: Estimates) -> list[tuple[str, str]]:
    """Return the code, octal, and the address, hexadecimal, of each target; empty if unknown."""
    found = estimates.known_attributes
    return [
        ("" if code == UNKNOWN else f"{code:04o}", "" if address == UNKNOWN else f"{address:06X}")
        for code, address in zip(found.code.tolist(), found.address.tolist(), strict=True)
    ]
