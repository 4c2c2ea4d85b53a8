"""Encodes plots as CAT048, an antenna's motion as CAT034, and tracks as CAT062 with CAT065."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .clocks import NS_PER_TICK
from .messages import (
    AZIMUTH_UNIT,
    DAY,
    FULL_TURN,
    NAUTICAL_MILE,
    NONE,
    NORTH,
    QUARTER_LEVEL,
    SECTOR,
    SECTOR_UNIT,
    TICKS_PER_S,
    Plot,
)
from .specification import Fixed, layouts

# Largest datagram, bytes, that passes common networks unfragmented.
MAX_BLOCK = 1400


def record(category: int, items: Mapping[str, bytes], kind: str = "") -> bytes:
    """Return a record: the selection of its items (FSPEC), then the items in the category's order.

    Raise `ValueError` if an item of fixed length has a different length.
    """
    layout = layouts(category)[kind]
    places = sorted(layout.place[name] for name in items)
    selection = bytearray(b"\1" * (places[-1] // 7) + b"\0")
    body = bytearray()
    for place in places:
        selection[place // 7] |= 0x80 >> place % 7
        name, rule = layout.names[place], layout.rules[place]
        item = items[name or ""]
        if isinstance(rule, Fixed) and len(item) != rule.size:
            raise ValueError(f"I{category:03d}/{name}: {len(item)} bytes, must be {rule.size}")
        body += item
    return bytes(selection + body)


def blocks(category: int, records: Iterable[bytes]) -> list[bytes]:
    """Return data blocks of at most `MAX_BLOCK` bytes with the records in order."""
    found: list[bytes] = []
    body = b""
    for each in records:
        if body and len(body) + len(each) + 3 > MAX_BLOCK:
            found.append(_block(category, body))
            body = b""
        body += each
    return [*found, _block(category, body)] if body else found


def _block(category: int, body: bytes) -> bytes:
    return bytes([category]) + (len(body) + 3).to_bytes(2, "big") + body


def unsigned(value: float, unit: float, size: int) -> bytes:
    """Encode a number in whole units, limited to the range of its bytes."""
    most: int = 256**size - 1
    # The limit is applied first, because infinity cannot be rounded.
    return round(min(max(value / unit, 0), most)).to_bytes(size, "big")


def signed(value: float, unit: float, size: int) -> bytes:
    """Encode a signed number in whole units, limited to the range of its bytes."""
    half: int = 256**size // 2
    return round(min(max(value / unit, -half), half - 1)).to_bytes(size, "big", signed=True)


def time_of_day(time_ns: int) -> bytes:
    """Encode a time since the epoch as a time of day in three bytes."""
    return (round(time_ns / NS_PER_TICK) % DAY).to_bytes(3, "big")


RANGE_UNIT = NAUTICAL_MILE / 256.0
# Upper bound of the range in I048/040, metres.
FARTHEST = (2**16 - 1) * RANGE_UNIT


def plot_record(plot: Plot, time_ns: int) -> bytes:
    """Encode a plot as a record of CAT048; one of an unknown type is sent as a primary plot.

    Ranges are limited to `FARTHEST`.
    """
    azimuth = round(plot.azimuth % FULL_TURN / AZIMUTH_UNIT) % 2**16
    items = {
        "010": plot.radar.to_bytes(2, "big"),
        "140": time_of_day(time_ns),
        "020": bytes([(plot.detection_type or 1) << 5]),
        "040": unsigned(plot.distance, RANGE_UNIT, 2) + azimuth.to_bytes(2, "big"),
    }
    if plot.code != NONE:
        items["070"] = plot.code.to_bytes(2, "big")
    if math.isfinite(plot.height):
        quarters = round(plot.height / QUARTER_LEVEL)
        items["090"] = (min(max(quarters, -(2**13)), 2**13 - 1) & 0x3FFF).to_bytes(2, "big")
    if plot.address != NONE:
        items["220"] = plot.address.to_bytes(3, "big")
    levels = ((0x20, plot.secondary_dbm), (0x08, plot.primary_dbm))
    known = [(bit, dbm) for bit, dbm in levels if math.isfinite(dbm)]
    if known:
        chosen = bytes([sum(bit for bit, _ in known)])
        items["130"] = chosen + b"".join(signed(dbm, 1.0, 1) for _, dbm in known)
    return record(48, items)


def plot_blocks(plots: list[tuple[int, Plot]]) -> list[bytes]:
    """Encode plots as data blocks, each plot with its time in nanoseconds since the epoch."""
    return blocks(48, [plot_record(plot, time_ns) for time_ns, plot in plots])


def service_block(radar: int, time_ns: int, azimuth: float, rotation_s: float) -> bytes:
    """Encode a service message: the antenna passes an azimuth, radians clockwise from north.

    Azimuth 0 is sent as a north mark. `radar` has SAC in the upper and SIC in the lower eight
    bits, and the rotation period, seconds, is 0 if unknown.
    """
    number = round(azimuth % FULL_TURN / SECTOR_UNIT) % 2**8
    items = {
        "010": radar.to_bytes(2, "big"),
        "000": bytes([SECTOR if number else NORTH]),
        "030": time_of_day(time_ns),
    }
    if number:
        items["020"] = bytes([number])
    if rotation_s:
        items["041"] = unsigned(rotation_s, 1.0 / TICKS_PER_S, 2)
    (block,) = blocks(34, [record(34, items)])
    return block


FOOT = 0.3048
# Units of I062/105, degrees; I062/100, m; I062/185, m/s; I062/290, s; heights and climbs.
GEODETIC_UNIT = 180.0 / 2**25
PLACE_UNIT, SPEED_UNIT, AGE_UNIT = 0.5, 0.25, 0.25
GEOMETRIC_UNIT, CLIMB_UNIT = 6.25 * FOOT, 6.25 * FOOT / 60.0
# Types of CAT065 messages.
STATUS, END_OF_BATCH = 1, 2
# Transversal accelerations (courses) and vertical rates of I062/200.
STRAIGHT, RIGHT, LEFT, UNKNOWN = range(4)
LEVEL, CLIMBING, DESCENDING = range(3)


@dataclass(frozen=True)
class Source:
    """Identification of the sending tracker."""

    sac: int  # System area code of the tracker
    sic: int  # System identification code
    service: int = 1  # Number of the service
    monosensor: bool = False  # True if there is only one radar
    # True if heights are above the ellipsoid; otherwise they refer to the standard atmosphere.
    geometric: bool = False

    @property
    def number(self) -> bytes:
        """SAC and SIC."""
        return bytes([self.sac, self.sic])


@dataclass(frozen=True)
class TrackReport:
    """A track at one time."""

    number: int  # From 0 to 65535
    position: tuple[float, float]  # In the system plane, x east and y north, m
    velocity: tuple[float, float]  # In the same plane, m/s
    geodetic: tuple[float, float] | None = None  # Latitude and longitude, degrees
    height: float = math.nan  # Metres; NaN if unknown
    climb: float = math.nan  # Upwards, m/s; NaN if unknown
    code: int = NONE
    address: int = NONE
    course: int = UNKNOWN  # `STRAIGHT`, `RIGHT`, `LEFT` or `UNKNOWN`
    vertical: int = UNKNOWN  # `LEVEL`, `CLIMBING`, `DESCENDING` or `UNKNOWN`
    confirmed: bool = True
    coasting: bool = False  # True if it has no recent plot
    first: bool = False  # True if it is reported for the first time
    last: bool = False  # True if it is reported for the last time
    age_s: float = 0.0  # Time since it was first reported
    since_s: float = 0.0  # Time since it last was not coasting
    # Times since the last detection by a primary radar, a secondary radar and Mode S; NaN for
    # never. All are NaN if the detecting sensors are unknown.
    sensor_ages_s: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    position_std: tuple[float, float] = (0.0, 0.0)  # Standard deviations along x and y, m
    velocity_std: tuple[float, float] = (0.0, 0.0)  # Standard deviations along x and y, m/s
    covariance: float = 0.0  # Covariance of x and y, square metres
    height_std: float = math.nan  # Metres; NaN if unknown
    climb_std: float = math.nan  # Metres per second; NaN if unknown
    call_sign: int = NONE
    # Altitude in the standard atmosphere, m; NaN if unknown, or if it is the height.
    pressure_altitude: float = math.nan
    # True if the height is above the ellipsoid, whatever those of the source usually are.
    geometric: bool = False
    # The trackers that have the track, the one whose estimate it is first: the number of each, from
    # 1, and its number of the track. Empty for a single tracker.
    composed: tuple[tuple[int, int], ...] = ()
    # What self-reports say: time since the last one of ADS-B, NaN for never; whether the track is
    # of reports alone; and whether it is not heard although others are.
    report_age_s: float = math.nan
    alone: bool = False
    unheard: bool = False


def track_record(track: TrackReport, time_ns: int, source: Source) -> bytes:
    """Encode a track as a record of CAT062.

    Values beyond the range of their item, such as more than 63.75 s since the last plot, are
    limited to it.
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
        # The last two bits are the longitudinal acceleration, which is undetermined (3).
        "200": bytes([track.course << 6 | UNKNOWN << 4 | track.vertical << 2]),
        "500": _accuracies(track, source),
    }
    if track.geodetic is not None:
        items["105"] = b"".join(_degrees(value) for value in track.geodetic)
    if track.code != NONE:
        items["060"] = track.code.to_bytes(2, "big")
    if track.call_sign != NONE:
        # The call sign comes from the aircraft's transponder.
        items["245"] = b"\x00" + track.call_sign.to_bytes(6, "big")
    if track.address != NONE:
        items["380"] = _aircraft(track)
    if track.composed:
        items["510"] = _composed(track)
    items |= _heights(track, source)
    if math.isfinite(track.climb):
        items["220"] = signed(track.climb, CLIMB_UNIT, 2)
    return record(62, items)


def _degrees(angle: float) -> bytes:
    # A longitude of 180 degrees is -180 in this item.
    half = 2**25
    units = (round(angle / GEODETIC_UNIT) + half) % (2 * half) - half
    return units.to_bytes(4, "big", signed=True)


def _aircraft(track: TrackReport) -> bytes:
    address = track.address.to_bytes(3, "big")
    if track.call_sign == NONE:
        return b"\x80" + address
    return b"\xc0" + address + track.call_sign.to_bytes(6, "big")


def _composed(track: TrackReport) -> bytes:
    """Encode I062/510; the last bit of each part says whether another follows."""
    last = len(track.composed) - 1
    return b"".join(
        bytes([unit % 256]) + (number % 2**15 << 1 | (k < last)).to_bytes(2, "big")
        for k, (unit, number) in enumerate(track.composed)
    )


def _status(track: TrackReport, source: Source) -> bytes:
    """Encode I062/080 up to the octet with the coasting flag.

    That octet also says that a track has no primary plots (PSR) and no recent self-report (ADS).
    """
    first = 0x80 * source.monosensor | 0x02 * (not track.confirmed)
    if (source.geometric or track.geometric) and math.isfinite(track.height):
        first |= 0x20 | 2 << 2  # The geometric height is more reliable; the source is plots
    second = 0x40 * track.last | 0x20 * track.first
    fourth = 0x80 * track.coasting | 0x40 * track.alone | 0x08 * track.unheard
    if not (second or fourth):
        return bytes([first])
    if not fourth:
        return bytes([first | 1, second])
    return bytes([first | 1, second | 1, 1, fourth])


def _ages(track: TrackReport) -> bytes:
    """Encode I062/290: the age of the track, and the times since its last detections by sensor.

    If the detecting sensors are unknown, there is one time: Mode S for a track with an address,
    else SSR for a track with a code, else PSR.
    """
    own = {
        bit: age
        for bit, age in zip((0x40, 0x20, 0x10), track.sensor_ages_s, strict=True)
        if math.isfinite(age)
    }
    if math.isfinite(track.report_age_s):
        own[0x04] = track.report_age_s
    if not own and not track.alone:
        assumed = 0x10 if track.address != NONE else 0x20 if track.code != NONE else 0x40
        own = {assumed: track.since_s}
    ages = (unsigned(age, AGE_UNIT, 1) for age in (track.age_s, *own.values()))
    return bytes([0x80 | sum(own)]) + b"".join(ages)


def _heights(track: TrackReport, source: Source) -> dict[str, bytes]:
    """Encode I062/130, the geometric height, or I062/135 and 136, those of the atmosphere."""
    if not math.isfinite(track.height):
        return {}
    if not (source.geometric or track.geometric):
        return _levels(track.height)
    items = {"130": signed(track.height, GEOMETRIC_UNIT, 2)}
    known = math.isfinite(track.pressure_altitude)
    return items | _levels(track.pressure_altitude) if known else items


def _levels(height: float) -> dict[str, bytes]:
    level = signed(height, QUARTER_LEVEL, 2)
    # This item has the same unit, and a bit for the QNH correction, which leaves one bit less.
    quarters = round(min(max(height / QUARTER_LEVEL, -(2**14)), 2**14 - 1))
    return {"136": level, "135": (quarters & 0x7FFF).to_bytes(2, "big")}


def _accuracies(track: TrackReport, source: Source) -> bytes:
    """Encode I062/500: standard deviations of position, height, velocity and climb."""
    size = math.copysign(math.sqrt(abs(track.covariance)), track.covariance)
    parts = {
        0x80: b"".join(unsigned(std, PLACE_UNIT, 2) for std in track.position_std),
        0x40: signed(size, PLACE_UNIT, 2),
        0x04: b"".join(unsigned(std, SPEED_UNIT, 1) for std in track.velocity_std),
    }
    if math.isfinite(track.height_std):
        geometric = source.geometric or track.geometric
        bit, unit = (0x10, GEOMETRIC_UNIT) if geometric else (0x08, QUARTER_LEVEL)
        parts[bit] = unsigned(track.height_std, unit, 1)
    extended = b""
    if math.isfinite(track.climb_std):
        extended = unsigned(track.climb_std, CLIMB_UNIT, 1)
    ordered = b"".join(parts[bit] for bit in sorted(parts, reverse=True))
    chosen = bytes([sum(parts) | 1, 0x80]) if extended else bytes([sum(parts)])
    return chosen + ordered + extended


def track_blocks(tracks: list[TrackReport], time_ns: int, source: Source) -> list[bytes]:
    """Encode tracks as data blocks."""
    return blocks(62, [track_record(track, time_ns, source) for track in tracks])


def status_block(time_ns: int, source: Source, batch: int) -> bytes:
    """Encode a tracker that works, and the end of a batch, as a data block of CAT065.

    `batch` is a running number, sent modulo 256.
    """
    who = {"010": source.number, "015": bytes([source.service]), "030": time_of_day(time_ns)}
    status = {**who, "000": bytes([STATUS]), "040": bytes(1)}
    end = {**who, "000": bytes([END_OF_BATCH]), "020": bytes([batch % 256])}
    (block,) = blocks(65, [record(65, status), record(65, end)])
    return block
