"""Decodes records of plot and service categories to `messages`.

Plots come from CAT048, CAT001 and CAT010, service messages from CAT034 and CAT002, and positions
(`positions`) from CAT010, CAT020, CAT021 and CAT062. A plot is
skipped and counted if it has no radar or no position, was extrapolated by the radar, or comes from
a test target or a field monitor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from . import messages, positions
from .messages import (
    AZIMUTH_UNIT,
    COMBINED,
    DAY,
    NAUTICAL_MILE,
    NO_DETECTION,
    NONE,
    NORTH,
    PRIMARY,
    ROLL_CALL,
    SECONDARY,
    SECTOR,
    SECTOR_UNIT,
    SITE_UNIT,
    TICKS_PER_S,
    TRUNCATED,
    Message,
    Plot,
    ServiceMessage,
)
from .positions import fault_of, read_level, read_quarters
from .specification import Layout, MalformedError, layouts

Items: TypeAlias = "tuple[int, ...]"


class Category(NamedTuple):
    """The decoder of the records of a category."""

    # Returns the message, or the reason why the record is skipped (empty if that is not counted),
    # given the record's bytes and the beginning of each item, -1 if the item is absent.
    decode: Callable[[bytes, Items], Message | str]
    items: tuple[str, ...]
    edition: tuple[int, int] | None = None  # None for the newest
    required: tuple[str, ...] = ()  # Items by which editions that are not compatible are told


class RecordReader:
    """Decodes the records of a category."""

    def __init__(self, number: int, category: Category) -> None:
        self._decode = category.decode
        self._kinds = {
            name: (layout, itemgetter(*(layout.place[item] for item in category.items)))
            for name, layout in layouts(number, category.edition).items()
        }
        self._required = category.required

    def read(self, data: bytes, at: int, limit: int) -> tuple[Message | str, int]:
        """Return the message of the record at `at`, and the record's end.

        In place of the message it may be the reason why the record is skipped, see `Category`.
        """
        layout, items = self._kind(data, at, limit)
        begins, end = layout.walk(data, at, limit)
        return self._decode(data, items(begins)), end

    def end(self, data: bytes, at: int, limit: int) -> int:
        """Return the end of the record at `at`."""
        return self._kind(data, at, limit)[0].walk(data, at, limit)[1]

    def fits(self, data: bytes, at: int, limit: int) -> bool:
        """Return whether all records of a block have this edition's form and required items."""
        layout, _ = self._kind(data, at, limit)
        try:
            while at < limit:
                begins, at = layout.walk(data, at, limit)
                if any(begins[layout.place[item]] < 0 for item in self._required):
                    return False
        except MalformedError:
            return False
        return True

    def source(self, data: bytes, at: int, limit: int) -> int:
        """Return SAC and SIC of the record at `at`, `NONE` if it does not begin with them."""
        begin = self._kind(data, at, limit)[0].first(data, at, limit, "010")
        return _word(data, begin) if 0 <= begin < limit - 1 else NONE

    def _kind(
        self, data: bytes, at: int, limit: int
    ) -> tuple[Layout, Callable[[list[int]], Items]]:
        """Return the layout of a record, and the function that selects its items.

        There are two for CAT001: the first bit of item 020, which both have at the same place,
        determines the layout.
        """
        if "" in self._kinds:
            return self._kinds[""]
        layout, _ = self._kinds["plot"]
        descriptor = layout.first(data, at, limit, "020")
        is_track = descriptor >= 0 and data[descriptor] & 0x80
        return self._kinds["track" if is_track else "plot"]


def _word(data: bytes, at: int) -> int:
    return data[at] << 8 | data[at + 1]


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte


def _time_of_day(data: bytes, at: int) -> int:
    return NONE if at < 0 else data[at] << 16 | data[at + 1] << 8 | data[at + 2]


def _code(data: bytes, at: int) -> int:
    """Return a Mode 3/A code; `NONE` if it is garbled or not validated."""
    if at < 0 or data[at] & 0xC0:
        return NONE
    return (data[at] & 0x0F) << 8 | data[at + 1]


def _address(data: bytes, at: int) -> int:
    if at < 0:
        return NONE
    return (data[at] << 16 | data[at + 1] << 8 | data[at + 2]) or NONE


def _descriptor(data: bytes, at: int) -> tuple[int, int]:
    """Return the first two octets of a target report descriptor, 0 for an absent one."""
    if at < 0:
        return 0, 0
    return data[at], data[at + 1] if data[at] & 1 else 0


def _monoradar(data: bytes, items: Items) -> Plot | str:
    at010, at140, at020, at040, at042, at070, at090, at110, at130, at220, at240 = items
    first, second = _descriptor(data, at020)
    detection_type = first >> 5
    if at020 >= 0 and detection_type == NO_DETECTION:
        return "no_detection"
    fault = fault_of(first & 0x02, second & 0x80, at010, max(at040, at042))
    if fault:
        return fault
    if at040 >= 0:
        distance = _word(data, at040) * (NAUTICAL_MILE / 256.0)
        azimuth = _word(data, at040 + 2) * AZIMUTH_UNIT
    else:
        distance, azimuth = _of_plane(data, at042)
    height = read_level(data, at090)
    if at110 >= 0 and math.isnan(height):
        height = read_quarters(data, at110)
    return Plot(
        _word(data, at010),
        _time_of_day(data, at140),
        DAY,
        distance,
        azimuth,
        height,
        _code(data, at070),
        _address(data, at220),
        detection_type,
        *_amplitudes(data, at130),
        messages.read_call_sign(data, at240),
    )


def _of_plane(data: bytes, at: int) -> tuple[float, float]:
    """Return range and azimuth of a Cartesian position in the radar's plane."""
    x, y = (int.from_bytes(data[k : k + 2], "big", signed=True) for k in (at, at + 2))
    unit = NAUTICAL_MILE / 128.0
    return unit * math.hypot(x, y), math.atan2(x, y) % (2.0 * math.pi)


def _amplitudes(data: bytes, at: int) -> tuple[float, float]:
    """Return the amplitudes of the primary plot and of the replies (I048/130), dBm, NaN for none.

    Each subitem has one byte, so the offset of a subitem is the number of subitems before it.
    """
    if at < 0:
        return math.nan, math.nan
    selected = data[at]
    primary = secondary = math.nan
    if selected & 0x20:
        secondary = float(_signed(data[at + 1 + (selected >> 6).bit_count()]))
    if selected & 0x08:
        primary = float(_signed(data[at + 1 + (selected >> 4).bit_count()]))
    return primary, secondary


def _old_monoradar(data: bytes, items: Items) -> Plot | str:
    """Decode a target report of CAT001, of old radars; its time has 16 bits only."""
    at010, at020, at040, at070, at090, at131, at141 = items
    first, second = _descriptor(data, at020)
    detection_type = first >> 4 & 3
    if at020 >= 0 and detection_type == NO_DETECTION:
        return "no_detection"
    fault = fault_of(first & 0x02, second & 0x80, at010, at040)
    if fault:
        return fault
    power = math.nan if at131 < 0 else float(_signed(data[at131]))
    return Plot(
        _word(data, at010),
        NONE if at141 < 0 else _word(data, at141),
        TRUNCATED,
        _word(data, at040) * (NAUTICAL_MILE / 128.0),
        _word(data, at040 + 2) * AZIMUTH_UNIT,
        read_level(data, at090),
        _code(data, at070),
        NONE,
        detection_type,
        power if detection_type in (PRIMARY, COMBINED) else math.nan,
        power if detection_type == SECONDARY else math.nan,
    )


# Types of surface reports (I010/020), as the corresponding types of I048/020.
_SURFACE = {0: SECONDARY, 1: ROLL_CALL, 3: PRIMARY}


def _surface(data: bytes, items: Items) -> Message | str:
    """Decode a surface movement report of CAT010; its range is in metres.

    Multilateration has a position in the place of range and azimuth.
    """
    at000, at010, at020, at040, at060, at090, at140, at220, *others = items
    if at000 >= 0 and data[at000] != 1:
        return ""  # An update cycle begins, or the sensor's state
    if at040 < 0 and max(others[3], others[4]) >= 0:
        return positions.read_surface(data, tuple(others))
    first, second = _descriptor(data, at020)
    fault = fault_of(second & 0x20, second & 0x40, at010, at040)
    if fault:
        return fault
    return Plot(
        _word(data, at010),
        _time_of_day(data, at140),
        DAY,
        float(_word(data, at040)),
        _word(data, at040 + 2) * AZIMUTH_UNIT,
        read_level(data, at090),
        _code(data, at060),
        _address(data, at220),
        _SURFACE.get(first >> 5, 0) if at020 >= 0 else 0,
    )


def _service(data: bytes, items: Items) -> ServiceMessage | str:
    """Decode a service message of CAT034, or of CAT002 of old radars, which is similar."""
    at010, at000, at020, at030, at041, *at120 = items
    if at010 < 0 or at000 < 0:
        return "no_radar" if at010 < 0 else "no_kind"
    kind, azimuth = data[at000], math.nan
    if kind == NORTH:
        azimuth = 0.0
    elif kind == SECTOR and at020 >= 0:
        azimuth = data[at020] * SECTOR_UNIT
    revolution = _word(data, at041) / TICKS_PER_S if at041 >= 0 else 0.0
    radar, time_of_day = _word(data, at010), _time_of_day(data, at030)
    return ServiceMessage(
        radar, time_of_day, kind, azimuth, revolution or math.nan, _site(data, *at120)
    )


def _site(data: bytes, at: int = NONE) -> tuple[float, float, float] | None:
    """Return the position of the data source (I034/120), None if it is absent or implausible.

    A radar whose position was never configured sends zeros.
    """
    if at < 0:
        return None
    height = int.from_bytes(data[at : at + 2], "big", signed=True)
    latitude, longitude = (
        SITE_UNIT * int.from_bytes(data[k : k + 3], "big", signed=True) for k in (at + 2, at + 5)
    )
    if abs(latitude) > 90.0 or not (latitude or longitude):
        return None
    return latitude, longitude, float(height)


def prepare() -> None:
    """Read the specifications of the usual categories, which takes a second."""
    for category in (34, 48, 62, 65):
        layouts(category)


_MONORADAR = ("010", "140", "020", "040", "042", "070", "090", "110", "130", "220", "240")
_SERVICE = ("010", "000", "020", "030", "041")
_SURFACE_PLOT = ("000", "010", "020", "040", "060", "090", "140", "220")
_SURFACE_POSITION = ("010", "020", "140", "041", "042", "161", "202", "090", "220", "245", "500")
_MULTILATERATION = ("010", "020", "140", "041", "042", "161", "202", "090", "220", "245")
_SQUITTER = ("080", "140", "145", "160", "170", "020")
_ADS_B = ("010", "040", "071", "073", "130", "131", "090", "210", *_SQUITTER)
_OLD_ADS_B = ("010", "040", "030", "130", "090", *_SQUITTER)
_REQUIRED = ("010", "040", "080")
_TRACK = ("010", "070", "105", "100", "185", "380", "040", "080", "136", "130", "135", "245", "500")
# The usual edition of each category first.
_CATEGORIES: Mapping[int, tuple[Category, ...]] = {
    1: (Category(_old_monoradar, ("010", "020", "040", "070", "090", "131", "141")),),
    2: (Category(_service, _SERVICE),),
    10: (Category(_surface, (*_SURFACE_PLOT, *_SURFACE_POSITION)),),
    20: (Category(positions.read_multilateration, (*_MULTILATERATION, "105", "500")),),
    21: (
        Category(positions.read_ads_b, _ADS_B, None, _REQUIRED),
        Category(positions.read_old_ads_b, _OLD_ADS_B, (0, 26), _REQUIRED),
        Category(partial(positions.read_old_ads_b, size=3), _OLD_ADS_B, (0, 23), _REQUIRED),
    ),
    34: (Category(_service, (*_SERVICE, "120")),),
    48: (Category(_monoradar, _MONORADAR),),
    62: (Category(positions.read_track, _TRACK),),
}


# Categories of plots and of positions; the others are of service messages. CAT010 has both.
PLOTS, POSITIONS = (1, 10, 48), (20, 21, 62)


@cache
def readers(category: int) -> tuple[RecordReader, ...]:
    """Return the decoders of a category's editions, none if the category is not supported.

    Only CAT021 has editions whose records have different items.
    """
    return tuple(RecordReader(category, known) for known in _CATEGORIES.get(category, ()))


def count(category: int, data: bytes, at: int, end: int) -> int:
    """Return the number of records in a data block, 0 if they cannot be decoded."""
    if known := readers(category):
        return max(_count(each.end, data, at, end) for each in known)
    try:
        layout = next(iter(layouts(category).values()))
    except LookupError:
        return 0
    return _count(lambda *place: layout.walk(*place)[1], data, at, end)


def _count(end_of: Callable[[bytes, int, int], int], data: bytes, at: int, end: int) -> int:
    found = 0
    try:
        while at < end:
            at = end_of(data, at, end)
            found += 1
    except MalformedError:
        return 0
    return found
