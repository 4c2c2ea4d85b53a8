"""Decodes records with positions to `PositionMessage`: what targets or another centre report.

ADS-B comes in CAT021 (editions 0.23 to 0.26, which have items of their own, and 2.x),
multilateration in CAT020 and CAT010, and another centre's tracks in CAT062. The functions get the
beginnings of the items that `records` names, -1 for those that are absent.
"""

from __future__ import annotations

import math

from phd_jdtc_ros.transponders.messages import (
    FOOT,
    ICAO,
    NOT_SAID,
    OTHER,
    TRACK_NUMBER,
    UNKNOWN_STD,
    Heard,
    of_nacp,
    of_nucp,
)

from .messages import (
    ADS_B,
    DAY,
    MULTILATERATION,
    NAUTICAL_MILE,
    NONE,
    QUARTER_LEVEL,
    TRACKS,
    PositionMessage,
    call_sign_text,
    read_call_sign,
)

# Units of latitudes and longitudes, degrees: of the usual 32 bits, of finer ones (I021/131 and
# I010/041), and of 24 bits.
WGS84, FINER, FINEST, COARSE = 180.0 / 2**25, 180.0 / 2**30, 180.0 / 2**31, 180.0 / 2**23
SPEED_UNIT, ANGLE_UNIT = NAUTICAL_MILE / 2**14, 360.0 / 2**16
ALTITUDE_UNIT, QUARTER = 6.25 * FOOT, 0.25


def read_ads_b(data: bytes, items: tuple[int, ...]) -> PositionMessage | str:
    """Decode CAT021 from edition 2.0 on."""
    at010, at040, at071, at073, at130, at131, at090, at210, *others = items
    first, second, third = _octets(data, at040, 3)
    fault = fault_of(first & 0x02, second & 0x10, at010, max(at130, at131))
    if fault:
        return fault
    if third & 0x0E:  # The station itself has refused the position: CPR, LDPJ, RCF
        return "position_check"
    navigation, accuracy = _octets(data, at090, 2)
    # The first octet has the accuracy (NUCp) of the oldest transponders, and a limit of all others.
    oldest = at210 >= 0 and not data[at210] >> 3 & 7
    std, accurate = of_nucp(navigation >> 1 & 15) if oldest else of_nacp(accuracy >> 1 & 15)
    place = _place(data, at130, 3, COARSE) if at131 < 0 else _place(data, at131, 4, FINER)
    heard = _squitter(data, others, ICAO if first >> 5 in (0, 1) else OTHER, place)
    heard = heard._replace(x_std=std, y_std=std, accurate=accurate)
    return _message(data, at010, at071 if at071 >= 0 else at073, ADS_B, heard)


def read_old_ads_b(data: bytes, items: tuple[int, ...], size: int = 4) -> PositionMessage | str:
    """Decode CAT021 of the editions 0.23 to 0.26; the first has latitudes of `size` 3 bytes."""
    at010, at040, at030, at130, at090, *others = items
    first, second = (data[at040], data[at040 + 1]) if at040 >= 0 else (0, 0)
    fault = fault_of(first & 0x08, first & 0x10, at010, at130)
    if fault:
        return fault
    place = _place(data, at130, size, WGS84 if size == 4 else COARSE)
    heard = _squitter(data, others, ICAO if second >> 5 == 1 else OTHER, place)
    std, accurate = of_nacp(data[at090 + 1] & 15) if at090 >= 0 else (UNKNOWN_STD, NOT_SAID)
    heard = heard._replace(x_std=std, y_std=std, accurate=accurate)
    return _message(data, at010, at030, ADS_B, heard)


def _squitter(data: bytes, items: list[int], space: int, place: tuple[float, float]) -> Heard:
    """Return what the items that all editions of CAT021 have say."""
    at080, at140, at145, at160, at170, at020 = items
    height = math.nan
    if at145 >= 0:
        height = _signed(data, at145, 2) * QUARTER_LEVEL
    elif at140 >= 0:
        height = _signed(data, at140, 2) * ALTITUDE_UNIT
    speed = course = math.nan
    if at160 >= 0:
        # The first bit says that the speed is larger than can be expressed.
        speed = (_unsigned(data, at160, 2) & 0x7FFF) * SPEED_UNIT
        course = _unsigned(data, at160 + 2, 2) * ANGLE_UNIT
    return Heard(
        space,
        _unsigned(data, at080, 3) if at080 >= 0 else NONE,
        latitude=place[0],
        longitude=place[1],
        speed=speed,
        course=course,
        height=height,
        name=call_sign_text(read_call_sign(data, at170)),
        type=data[at020] if at020 >= 0 else 0,
    )


def read_multilateration(data: bytes, items: tuple[int, ...]) -> PositionMessage | str:
    """Decode CAT020; its accuracies are those of I020/500, along east and north."""
    at010, at020, at140, at041, at042, at161, at202, at090, at220, at245, at105, at500 = items
    _, second, *_ = _octets(data, at020, 2)
    fault = fault_of(second & 0x80, second & 0x02, at010, max(at041, at042))
    if fault:
        return fault
    height = read_level(data, at090)
    if math.isnan(height) and at105 >= 0:
        height = _signed(data, at105, 2) * ALTITUDE_UNIT
    x_std = y_std = UNKNOWN_STD
    if at500 >= 0 and data[at500] & 0x40:
        at = at500 + 1 + (6 if data[at500] & 0x80 else 0)
        x_std, y_std = (QUARTER * _unsigned(data, at + k, 2) or UNKNOWN_STD for k in (0, 2))
    heard = _located(data, (at161, at220, at202, at245), _place(data, at041, 4, WGS84))
    heard = heard._replace(height=height, x_std=x_std, y_std=y_std)
    return _message(data, at010, at140, MULTILATERATION, heard, (at042, 3, 0.5))


def read_surface(data: bytes, items: tuple[int, ...]) -> PositionMessage | str:
    """Decode a surface movement report of CAT010 that has no range and azimuth."""
    at010, at020, at140, at041, at042, at161, at202, at090, at220, at245, at500 = items
    first, second, *_ = _octets(data, at020, 2)
    fault = fault_of(second & 0x20, second & 0x40, at010, max(at041, at042))
    # Types of I010/020 that are positions of transponders, and not radar plots or loops.
    if fault or first >> 5 not in (0, 1, 2, 5):
        return fault or "no_position"
    x_std = y_std = UNKNOWN_STD
    if at500 >= 0:
        x_std, y_std = (QUARTER * data[at500 + k] or UNKNOWN_STD for k in (0, 1))
    heard = _located(data, (at161, at220, at202, at245), _place(data, at041, 4, FINEST))
    heard = heard._replace(height=read_level(data, at090), x_std=x_std, y_std=y_std)
    return _message(data, at010, at140, MULTILATERATION, heard, (at042, 2, 1.0))


def _located(data: bytes, items: tuple[int, ...], place: tuple[float, float]) -> Heard:
    """Return what CAT020 and CAT010 say of a target, by its address or else its track number."""
    at161, at220, at202, at245 = items
    address = _unsigned(data, at220, 3) if at220 >= 0 else 0
    number = _unsigned(data, at161, 2) & 0xFFF if at161 >= 0 else NONE
    speed, course = _velocity(data, at202)
    return Heard(
        ICAO if address else TRACK_NUMBER,
        address or number,
        latitude=place[0],
        longitude=place[1],
        speed=speed,
        course=course,
        name=call_sign_text(read_call_sign(data, at245 + 1)) if at245 >= 0 else "",
    )


def read_track(data: bytes, items: tuple[int, ...]) -> PositionMessage | str:
    """Decode another centre's track of CAT062, by its number; extrapolated ones are left out."""
    at010, at070, at105, at100, at185, at380, at040, at080, *heights, at245, at500 = items
    at136, at130, at135 = heights
    fault = fault_of(0, 0, at010, max(at105, at100))
    if fault:
        return fault
    status = _octets(data, at080, 4)
    if status[1] & 0x40 or status[3] & 0x80:  # TSE, CST
        return "no_detection"
    height = math.nan
    if at136 >= 0:
        height = _signed(data, at136, 2) * QUARTER_LEVEL
    elif at135 >= 0:
        # The first bit says that it is corrected for the pressure of the day.
        level = _unsigned(data, at135, 2) & 0x7FFF
        height = (level - 2**15 if level & 0x4000 else level) * QUARTER_LEVEL
    elif at130 >= 0:
        height = _signed(data, at130, 2) * ALTITUDE_UNIT
    latitude, longitude = _place(data, at105, 4, WGS84)
    speed, course = _velocity(data, at185)
    x_std, y_std, correlation = _accuracy(data, at500)
    heard = Heard(
        TRACK_NUMBER,
        _unsigned(data, at040, 2) if at040 >= 0 else NONE,
        latitude=latitude,
        longitude=longitude,
        speed=speed,
        course=course,
        height=height,
        x_std=x_std,
        y_std=y_std,
        correlation=correlation,
        name=_track_name(data, at245, at380),
    )
    return _message(data, at010, at070, TRACKS, heard, (at100, 3, 0.5))


def _track_name(data: bytes, at245: int, at380: int) -> str:
    """Return a track's call sign, its own or that of the aircraft."""
    if at245 >= 0:
        return call_sign_text(read_call_sign(data, at245 + 1))
    if at380 >= 0 and data[at380] & 0x40:
        at = at380 + len(_chain(data, at380)) + (3 if data[at380] & 0x80 else 0)
        return call_sign_text(read_call_sign(data, at))
    return ""


def _accuracy(data: bytes, at: int) -> tuple[float, float, float]:
    """Return the standard deviations to the east and to the north, metres, and the correlation.

    I062/500 has the covariance as the root of its magnitude with its sign.
    """
    if at < 0 or not data[at] & 0x80:
        return UNKNOWN_STD, UNKNOWN_STD, 0.0
    begin = at + len(_chain(data, at))
    x_std, y_std = (0.5 * _unsigned(data, begin + k, 2) for k in (0, 2))
    if not (x_std and y_std):
        return UNKNOWN_STD, UNKNOWN_STD, 0.0
    root = 0.5 * _signed(data, begin + 4, 2) if data[at] & 0x40 else 0.0
    correlation = math.copysign(root**2, root) / (x_std * y_std)
    return x_std, y_std, correlation if abs(correlation) < 1.0 else 0.0


def _message(
    data: bytes,
    at010: int,
    at_time: int,
    source: str,
    heard: Heard,
    plane: tuple[int, int, float] = (-1, 0, 0.0),
) -> PositionMessage:
    """Return a message; `plane` has where x and y begin, their size in bytes and their unit."""
    at, size, unit = plane
    x, y = math.nan, math.nan
    if at >= 0 and not heard.has_position:
        x, y = (unit * _signed(data, at + k, size) for k in (0, size))
    time = NONE if at_time < 0 else _unsigned(data, at_time, 3)
    return PositionMessage(_unsigned(data, at010, 2), time, DAY, source, heard, x, y)


def fault_of(monitor: int, test: int, source: int, position: int) -> str:
    """Return the reason for skipping a record, empty for none.

    `monitor` and `test` are bits of its descriptor, `source` and `position` beginnings of items.
    """
    if monitor:
        return "field_monitor"
    if test:
        return "test_target"
    if source < 0:
        return "no_radar"
    return "no_position" if position < 0 else ""


def _chain(data: bytes, at: int) -> list[int]:
    """Return octets of which the last bit of each announces the next."""
    found = [data[at]]
    while found[-1] & 1:
        found.append(data[at + len(found)])
    return found


def _octets(data: bytes, at: int, count: int) -> list[int]:
    """Return the first octets of an extended item, 0 for those that are absent."""
    found = _chain(data, at) if at >= 0 else []
    return [*found, *[0] * count][:count]


def _unsigned(data: bytes, at: int, size: int) -> int:
    return int.from_bytes(data[at : at + size], "big")


def _signed(data: bytes, at: int, size: int) -> int:
    return int.from_bytes(data[at : at + size], "big", signed=True)


def _place(data: bytes, at: int, size: int, unit: float) -> tuple[float, float]:
    """Return a latitude and a longitude, degrees, NaN if the item is absent."""
    if at < 0:
        return math.nan, math.nan
    return unit * _signed(data, at, size), unit * _signed(data, at + size, size)


def _velocity(data: bytes, at: int) -> tuple[float, float]:
    """Return speed, m/s, and course, degrees, of a velocity to the east and to the north."""
    if at < 0:
        return math.nan, math.nan
    east, north = (QUARTER * _signed(data, at + k, 2) for k in (0, 2))
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0


def read_level(data: bytes, at: int) -> float:
    """Return a flight level in metres; NaN if it is absent, garbled or not validated."""
    return math.nan if at < 0 or data[at] & 0xC0 else read_quarters(data, at)


def read_quarters(data: bytes, at: int) -> float:
    """Return a signed 14-bit number of quarters of a flight level, in metres."""
    quarters = (data[at] & 0x3F) << 8 | data[at + 1]
    return QUARTER_LEVEL * (quarters - 2**14 if quarters & 0x2000 else quarters)
