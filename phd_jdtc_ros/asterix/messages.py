"""What messages of radars say, category by category, in SI units.

A record of a plot category becomes a `Plot`, one of a service category a `ServiceMessage`.
Azimuths stay clockwise from north here, as radars count them.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

# Times of day are in units of 1/128 s; some messages have only the lowest 16 bits of them.
TICKS_PER_S = 128
DAY = 86_400 * TICKS_PER_S
TRUNCATED = 2**16
NAUTICAL_MILE = 1852.0
# A quarter of a flight level, which is 25 ft.
QUARTER_LEVEL = 7.62
AZIMUTH_UNIT = 2.0 * math.pi / 2**16
SECTOR_UNIT = 2.0 * math.pi / 2**8
# Of latitudes and longitudes in I034/120, degrees.
SITE_UNIT = 180.0 / 2**23
# A code, an address, a time that a message does not say.
NONE = -1
# Kinds of plots, the TYP of I048/020.
NO_DETECTION, PRIMARY, SECONDARY, COMBINED, ALL_CALL, ROLL_CALL = range(6)
# Kinds of service messages, I034/000.
NORTH, SECTOR = 1, 2


class Plot(NamedTuple):
    """One plot.

    Parameters
    ----------
    radar : int
        SAC in the upper, SIC in the lower eight bits.
    time_of_day : int
        UTC, 1/128 s, modulo `period`; `NONE` if unknown.
    period : int
        `DAY`, or `TRUNCATED`.
    distance : float
        Slant range, metres.
    azimuth : float
        Radians clockwise from north.
    height : float
        By the flight level, or else measured, metres; NaN if unknown.
    code, address : int
        Mode 3/A code and Mode S address; `NONE` if unknown.
    kind : int
        Such as `PRIMARY`; 0 if unknown.
    primary_dbm, secondary_dbm : float
        Amplitudes of the echo and of the replies, dBm; NaN if unknown.
    call_sign : int
        Its 48 bits (I048/240); `NONE` if unknown.
    """

    radar: int
    time_of_day: int
    period: int
    distance: float
    azimuth: float
    height: float
    code: int
    address: int
    kind: int
    primary_dbm: float
    secondary_dbm: float
    call_sign: int = NONE


class ServiceMessage(NamedTuple):
    """What a radar says of itself.

    Parameters
    ----------
    radar : int
        SAC in the upper, SIC in the lower eight bits.
    time_of_day : int
        UTC, 1/128 s; `NONE` if unknown.
    kind : int
        `NORTH`, `SECTOR`, or another.
    azimuth : float
        That the antenna passes, radians clockwise from north; NaN if unknown.
    rotation_s : float
        Time of a turn; NaN if unknown.
    site : tuple of three floats or None
        Where the radar stands: latitude and longitude, degrees, and height, metres.
    """

    radar: int
    time_of_day: int
    kind: int
    azimuth: float
    rotation_s: float
    site: tuple[float, float, float] | None = None


Message: TypeAlias = "Plot | ServiceMessage"
