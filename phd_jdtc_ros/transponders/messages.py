"""What one message says of its transmitter, whatever the format, and the accuracy of positions."""

from __future__ import annotations

import math
from typing import NamedTuple

# Marks an address or a time that is absent.
NONE = -1
# Identity spaces: an address is unique in its space only.
ICAO, MMSI, TRACK_NUMBER, OTHER = range(1, 5)
# Networks, which name the topics.
AIS, ADSB = "ais", "adsb"
NAME_SIZE = 20
KNOT, FOOT = 1852.0 / 3600.0, 0.3048
# Marks that a source does not say whether its position is accurate.
NOT_SAID = 255
# Standard deviation on each axis of a position whose accuracy is unknown, metres.
UNKNOWN_STD = 50.0


class Heard(NamedTuple):
    """What a message says; unknown numbers are NaN."""

    space: int  # Identity space, such as `MMSI`
    address: int  # Number in that space; `NONE` without one
    # Own time of the position, nanoseconds since the epoch, modulo `period_ns`; `NONE` without one.
    own_ns: int = NONE
    period_ns: int = 0  # 0 if the time is whole
    latitude: float = math.nan  # Degrees
    longitude: float = math.nan
    speed: float = math.nan  # Over ground, metres per second
    course: float = math.nan  # Over ground, degrees clockwise from true north
    heading: float = math.nan  # Direction of the bow, degrees clockwise from true north
    height: float = math.nan  # Of the standard atmosphere, or else geometric, metres
    # Standard deviations of the position to the east and to the north, metres.
    x_std: float = math.nan
    y_std: float = math.nan
    correlation: float = 0.0  # Of both errors
    accurate: int = NOT_SAID  # 1 if within 10 m, 0 if not
    name: str = ""  # Name or call sign
    type: int = 0  # Type of ship, or the emitter category of I021/020; 0 if unknown
    # Distances of the antenna from bow, stern, port and starboard, metres. Those from bow and port
    # are 0 if only the ship's size is known.
    hull: tuple[int, int, int, int] | None = None
    # Shortest interval at which such a transmitter reports its place, seconds.
    interval_s: float = math.nan
    network: str = ADSB
    long_range: bool = False  # A coarse position for satellites, AIS type 27
    own_ship: bool = False  # Of the ship that the receiver is on
    clock: bool = False  # The time of a base station, without a target

    @property
    def has_position(self) -> bool:
        """Whether it reports a place."""
        return not math.isnan(self.latitude)


def of_nacp(category: int) -> tuple[float, int]:
    """Return the standard deviation on each axis of an accuracy category, and `Heard.accurate`."""
    # Radii with 95 % of the errors (EPU) from category 1 on, RTCA DO-260B, table 2-71, metres.
    radii = (18520.0, 7408.0, 3704.0, 1852.0, 926.0, 555.6, 185.2, 92.6, 30.0, 10.0, 3.0)
    return _of_radius(radii, category)


def of_nucp(category: int) -> tuple[float, int]:
    """Return the same as `of_nacp` for a category of transponders of DO-260, table 2-11."""
    radii = (18520.0, 9260.0, 1852.0, 926.0, 463.0, 185.2, 92.6, 10.0, 3.0)
    return _of_radius(radii, category)


def _of_radius(radii: tuple[float, ...], category: int) -> tuple[float, int]:
    if not 0 < category <= len(radii):
        return UNKNOWN_STD, NOT_SAID
    radius = radii[category - 1]
    # Standard deviations of a circular normal distribution with 95 % within the radius.
    return radius / math.sqrt(-2.0 * math.log(0.05)), int(radius <= 10.0)
