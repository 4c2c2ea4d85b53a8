"""The content of radar messages, independent of the category, in SI units.

A record of a plot category becomes a `Plot`, one of a service category a `ServiceMessage`, and one
of a category of positions a `PositionMessage`.
Azimuths remain clockwise from north, as radars report them. `CallSigns` keeps the names of
aircraft by their addresses.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from phd_jdtc_ros.transponders.messages import Heard

# Times of day are in units of 1/128 s; some messages have only the lowest 16 bits of them.
TICKS_PER_S = 128
DAY = 86_400 * TICKS_PER_S
TRUNCATED = 2**16
NAUTICAL_MILE, FULL_TURN = 1852.0, 2.0 * math.pi
# A quarter of a flight level, which is 25 ft.
QUARTER_LEVEL = 7.62
AZIMUTH_UNIT, SECTOR_UNIT = FULL_TURN / 2**16, FULL_TURN / 2**8
# Unit of latitude and longitude in I034/120, degrees.
SITE_UNIT = 180.0 / 2**23
# Marks a code, an address or a time that is absent from a message.
NONE = -1
# Kinds of plots, the TYP of I048/020.
NO_DETECTION, PRIMARY, SECONDARY, COMBINED, ALL_CALL, ROLL_CALL = range(6)
# Kinds of service messages, I034/000.
NORTH, SECTOR = 1, 2


class Plot(NamedTuple):
    """One plot of a radar, whichever category its record is of."""

    radar: int  # SAC in the upper, SIC in the lower eight bits
    time_of_day: int  # UTC, 1/128 s, modulo `period`; `NONE` if unknown
    period: int  # `DAY`, or `TRUNCATED`
    distance: float  # Slant range, metres
    azimuth: float  # Radians clockwise from north
    height: float = math.nan  # From the flight level, or else measured, metres; NaN if unknown
    code: int = NONE  # Mode 3/A code; `NONE` if unknown
    address: int = NONE  # Mode S address; `NONE` if unknown
    detection_type: int = 0  # Such as `PRIMARY`; 0 if unknown
    primary_dbm: float = math.nan  # Amplitude of the echo, dBm; NaN if unknown
    secondary_dbm: float = math.nan  # Amplitude of the replies, dBm; NaN if unknown
    call_sign: int = NONE  # The 48 bits of I048/240; `NONE` if unknown


class ServiceMessage(NamedTuple):
    """A radar's report on its own state."""

    radar: int  # SAC in the upper, SIC in the lower eight bits
    time_of_day: int  # UTC, 1/128 s; `NONE` if unknown
    kind: int  # `NORTH`, `SECTOR`, or another kind
    azimuth: float  # Azimuth that the antenna passes, radians clockwise from north; NaN if unknown
    rotation_s: float  # Rotation period, seconds; NaN if unknown
    # Position of the radar: latitude and longitude, degrees, and height, metres.
    site: tuple[float, float, float] | None = None

    @property
    def period(self) -> int:
        """See `Plot.period`; times of service messages are never truncated."""
        return DAY


# Sources of positions, which name them without a name of their own.
ADS_B, MULTILATERATION, TRACKS = "adsb", "mlat", "tracks"


class PositionMessage(NamedTuple):
    """A position that a target, or another centre, reports."""

    radar: int  # SAC in the upper, SIC in the lower eight bits
    time_of_day: int  # UTC, 1/128 s; `NONE` if unknown
    period: int  # `DAY`
    source: str  # `ADS_B`, `MULTILATERATION` or `TRACKS`
    heard: Heard  # Without a latitude and a longitude if the place is in a plane
    # East and north of the source's reference point, metres; NaN with a latitude.
    x: float = math.nan
    y: float = math.nan


Message: TypeAlias = "Plot | ServiceMessage | PositionMessage"


# A call sign has CHARACTERS of BITS bits each: letters from 1, a space, and digits.
CHARACTERS, BITS = 8, 6
_VALID = frozenset((*range(1, 27), 32, *range(48, 58)))
_SPACE = 32
# Upper bound of the call signs kept; the least recent ones are dropped.
MOST_CALL_SIGNS = 10_000


def read_call_sign(data: bytes, at: int) -> int:
    """Return a call sign as its 48 bits, `NONE` if it is absent, blank or garbled."""
    if at < 0:
        return NONE
    found = int.from_bytes(data[at : at + CHARACTERS * BITS // 8], "big")
    parts = {found >> BITS * place & 63 for place in range(CHARACTERS)}
    return found if parts <= _VALID and parts != {_SPACE} else NONE


def call_sign_text(call_sign: int) -> str:
    """Return a call sign's letters and digits; empty for `NONE`."""
    if call_sign == NONE:
        return ""
    places = range(CHARACTERS * BITS - BITS, -1, -BITS)
    letters = (call_sign >> place & 63 for place in places)
    return "".join(chr(each + 64 * (each <= 26)) for each in letters).strip()


def call_sign_of(text: str) -> int:
    """Return a name as a call sign: its first letters and digits; `NONE` without any."""
    letters = [each for each in text.upper() if each.isascii() and (each.isalnum() or each == " ")]
    found = 0
    for each in "".join(letters)[:CHARACTERS].strip().ljust(CHARACTERS):
        found = found << BITS | ord(each) & 63
    return found if any(each != " " for each in letters) else NONE


class CallSigns:
    """The latest call sign of each address."""

    def __init__(self) -> None:
        self._by_address: dict[int, int] = {}

    def take(self, address: int, call_sign: int) -> None:
        """Add the call sign and the address of one plot; either may be `NONE`."""
        if address == NONE or call_sign == NONE:
            return
        self._by_address.pop(address, None)
        self._by_address[address] = call_sign
        if len(self._by_address) > MOST_CALL_SIGNS:
            del self._by_address[next(iter(self._by_address))]

    def of(self, address: int) -> int:
        """Return the call sign of an address, `NONE` if unknown."""
        return self._by_address.get(address, NONE)
