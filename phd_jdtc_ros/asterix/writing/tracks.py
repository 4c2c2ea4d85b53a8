"""Tracks as CAT062, and the state of the tracker as CAT065."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..messages import NONE, QUARTER_LEVEL
from .encoding import blocks, record, signed, time_of_day, unsigned

FOOT = 0.3048
# Units of I062/105, degrees; I062/100, m; I062/185, m/s; I062/290, s; heights and climbs.
GEODETIC_UNIT = 180.0 / 2**25
PLACE_UNIT, SPEED_UNIT, AGE_UNIT = 0.5, 0.25, 0.25
GEOMETRIC_UNIT, CLIMB_UNIT = 6.25 * FOOT, 6.25 * FOOT / 60.0
# What a message of CAT065 is.
STATUS, END_OF_BATCH = 1, 2
# Courses and climbs of I062/200.
STRAIGHT, RIGHT, LEFT, UNKNOWN = range(4)
LEVEL, CLIMBING, DESCENDING = range(3)


@dataclass(frozen=True)
class Source:
    """Who sends.

    Parameters
    ----------
    sac, sic : int
        Of the tracker.
    service : int
        Number of the service.
    monosensor : bool
        Whether there is one radar only.
    geometric : bool
        Whether heights are over the ellipsoid and not those of the standard atmosphere.
    """

    sac: int
    sic: int
    service: int = 1
    monosensor: bool = False
    geometric: bool = False

    @property
    def number(self) -> bytes:
        """SAC and SIC."""
        return bytes([self.sac, self.sic])


@dataclass(frozen=True)
class TrackReport:
    """A track at one time.

    Parameters
    ----------
    number : int
        From 0 to 65535.
    position, velocity : tuple of two floats
        In the system plane, m and m/s, x east and y north.
    geodetic : tuple of two floats or None
        Latitude and longitude, degrees.
    height, climb : float
        m and m/s; NaN if unknown.
    code, address, call_sign : int
        `NONE` if unknown.
    course : int
        `STRAIGHT`, `RIGHT`, `LEFT` or `UNKNOWN`.
    vertical : int
        `LEVEL`, `CLIMBING`, `DESCENDING` or `UNKNOWN`.
    confirmed, coasting, first, last : bool
        Whether it is confirmed, has no recent plot, is reported for the first or the last time.
    age_s, since_s : float
        Since the track was first reported, and since it was last not coasting.
    sensor_ages_s : tuple of three floats
        Since a primary radar, a secondary one and Mode S last saw it; NaN for never. Where all are
        NaN it is not known what saw it.
    position_std, velocity_std : tuple of two floats
        Along x and y.
    covariance : float
        Of x and y, square metres.
    height_std, climb_std : float
        NaN if unknown.
    """

    number: int
    position: tuple[float, float]
    velocity: tuple[float, float]
    geodetic: tuple[float, float] | None = None
    height: float = math.nan
    climb: float = math.nan
    code: int = NONE
    address: int = NONE
    course: int = UNKNOWN
    vertical: int = UNKNOWN
    confirmed: bool = True
    coasting: bool = False
    first: bool = False
    last: bool = False
    age_s: float = 0.0
    since_s: float = 0.0
    sensor_ages_s: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    position_std: tuple[float, float] = (0.0, 0.0)
    velocity_std: tuple[float, float] = (0.0, 0.0)
    covariance: float = 0.0
    height_std: float = math.nan
    climb_std: float = math.nan
    call_sign: int = NONE


def track_record(track: TrackReport, time_ns: int, source: Source) -> bytes:
    """Return a track as a record of CAT062.

    Times of more than 63.75 s since the last plot, and what else is larger than its item allows,
    are the largest value.
    """
    items = {
        "010": source.number,
        "015": bytes([source.service]),
        "070": time_of_day(time_ns),
        "100": b"".join(signed(value, PLACE_UNIT, 3) for value in track.position),
        "185": b"".join(signed(value, SPEED_UNIT, 2) for value in track.velocity),
        "040": track.number.to_bytes(2, "big"),
        "080": _status(track, source),
        "290": _ages(track),
        # The last two bits of accelerations are those of "not known" (3).
        "200": bytes([track.course << 6 | UNKNOWN << 4 | track.vertical << 2]),
        "500": _accuracies(track, source),
    }
    if track.geodetic is not None:
        items["105"] = b"".join(signed(value, GEODETIC_UNIT, 4) for value in track.geodetic)
    if track.code != NONE:
        items["060"] = track.code.to_bytes(2, "big")
    if track.call_sign != NONE:
        # Of the aircraft itself, as its transponder says it.
        items["245"] = b"\x00" + track.call_sign.to_bytes(6, "big")
    if track.address != NONE:
        items["380"] = _aircraft(track)
    if math.isfinite(track.height):
        items |= _heights(track.height, source)
    if math.isfinite(track.climb):
        items["220"] = signed(track.climb, CLIMB_UNIT, 2)
    return record(62, items)


def _aircraft(track: TrackReport) -> bytes:
    """Return I062/380: the address and the call sign."""
    address = track.address.to_bytes(3, "big")
    if track.call_sign == NONE:
        return b"\x80" + address
    return b"\xc0" + address + track.call_sign.to_bytes(6, "big")


def _status(track: TrackReport, source: Source) -> bytes:
    """Return I062/080, up to the octet that says whether a track coasts."""
    first = 0x80 * source.monosensor | 0x02 * (not track.confirmed)
    if source.geometric and math.isfinite(track.height):
        first |= 0x20 | 2 << 2  # the geometric height is the more reliable, and from plots
    second = 0x40 * track.last | 0x20 * track.first
    fourth = 0x80 * track.coasting
    if not (second or fourth):
        return bytes([first])
    if not fourth:
        return bytes([first | 1, second])
    return bytes([first | 1, second | 1, 1, fourth])


def _ages(track: TrackReport) -> bytes:
    """Return I062/290: the age of the track, and the times since sensors last saw it.

    Where it is not known what saw it, there is one time: that of Mode S for a track with an
    address, or else of SSR for one with a code, or else of PSR.
    """
    own = {
        bit: age
        for bit, age in zip((0x40, 0x20, 0x10), track.sensor_ages_s, strict=True)
        if math.isfinite(age)
    }
    if not own:
        supposed = 0x10 if track.address != NONE else 0x20 if track.code != NONE else 0x40
        own = {supposed: track.since_s}
    ages = (unsigned(age, AGE_UNIT, 1) for age in (track.age_s, *own.values()))
    return bytes([0x80 | sum(own)]) + b"".join(ages)


def _heights(height: float, source: Source) -> dict[str, bytes]:
    if source.geometric:
        return {"130": signed(height, GEOMETRIC_UNIT, 2)}
    level = signed(height, QUARTER_LEVEL, 2)
    # The same with a bit for a correction by the pressure of the day, and so one bit less.
    quarters = round(min(max(height / QUARTER_LEVEL, -(2**14)), 2**14 - 1))
    return {"136": level, "135": (quarters & 0x7FFF).to_bytes(2, "big")}


def _accuracies(track: TrackReport, source: Source) -> bytes:
    """Return I062/500: deviations of position, height, velocity and climb."""
    size = math.copysign(math.sqrt(abs(track.covariance)), track.covariance)
    parts = {
        0x80: b"".join(unsigned(std, PLACE_UNIT, 2) for std in track.position_std),
        0x40: signed(size, PLACE_UNIT, 2),
        0x04: b"".join(unsigned(std, SPEED_UNIT, 1) for std in track.velocity_std),
    }
    if math.isfinite(track.height_std):
        bit, unit = (0x10, GEOMETRIC_UNIT) if source.geometric else (0x08, QUARTER_LEVEL)
        parts[bit] = unsigned(track.height_std, unit, 1)
    extended = b""
    if math.isfinite(track.climb_std):
        extended = unsigned(track.climb_std, CLIMB_UNIT, 1)
    ordered = b"".join(parts[bit] for bit in sorted(parts, reverse=True))
    chosen = bytes([sum(parts) | 1, 0x80]) if extended else bytes([sum(parts)])
    return chosen + ordered + extended


def track_blocks(tracks: list[TrackReport], time_ns: int, source: Source) -> list[bytes]:
    """Return data blocks of tracks."""
    return blocks(62, [track_record(track, time_ns, source) for track in tracks])


def status_block(time_ns: int, source: Source, batch: int, overloaded: bool = False) -> bytes:
    """Return a data block of CAT065: the state of the tracker, and that a batch ends.

    Parameters
    ----------
    batch : int
        Counted on; modulo 256 in the message.
    """
    who = {
        "010": source.number,
        "015": bytes([source.service]),
        "030": time_of_day(time_ns),
    }
    status = {**who, "000": bytes([STATUS]), "040": bytes([0x20 * overloaded])}
    end = {**who, "000": bytes([END_OF_BATCH]), "020": bytes([batch % 256])}
    (block,) = blocks(65, [record(65, status), record(65, end)])
    return block
