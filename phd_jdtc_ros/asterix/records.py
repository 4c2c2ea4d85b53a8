"""Decodes records of plot and service categories to `messages`.

Plots come from CAT048, CAT001 and CAT010, service messages from CAT034 and CAT002. A plot is
skipped and counted if it has no radar or no position, was extrapolated by the radar, or comes from
a test target or a field monitor.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from functools import cache

from . import call_signs
from .messages import (
    AZIMUTH_UNIT,
    COMBINED,
    DAY,
    NAUTICAL_MILE,
    NO_DETECTION,
    NONE,
    NORTH,
    PRIMARY,
    QUARTER_LEVEL,
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
from .specification import layouts


class RecordReader(ABC):
    """Decodes the records of a category."""

    def __init__(self, category: int) -> None:
        self._layouts = layouts(category)
        self._layout = next(iter(self._layouts.values()))
        self._place = self._layout.place

    def read(
        self, data: bytes, at: int, limit: int, counts: Counter[str]
    ) -> tuple[Message | None, int]:
        """Return the message of the record at `at`, None if it is skipped, and the record's end."""
        begins, end = self._layout.walk(data, at, limit)
        return self._message(data, begins, counts), end

    @abstractmethod
    def _message(self, data: bytes, begins: list[int], counts: Counter[str]) -> Message | None:
        """Decode a record; `begins` has the beginning of each item in the layout's order."""

    def _radar(self, data: bytes, begins: list[int]) -> int:
        """Return SAC and SIC as one number, `NONE` if the record has none."""
        at = begins[self._place["010"]]
        return NONE if at < 0 else data[at] << 8 | data[at + 1]


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


def _level(data: bytes, at: int) -> float:
    """Return a flight level in metres; NaN if it is garbled or not validated."""
    if at < 0 or data[at] & 0xC0:
        return math.nan
    return _quarters(data, at)


def _quarters(data: bytes, at: int) -> float:
    """Return a signed 14-bit number of quarters of a flight level, in metres."""
    quarters = (data[at] & 0x3F) << 8 | data[at + 1]
    return QUARTER_LEVEL * (quarters - 2**14 if quarters & 0x2000 else quarters)


def _address(data: bytes, at: int) -> int:
    if at < 0:
        return NONE
    return (data[at] << 16 | data[at + 1] << 8 | data[at + 2]) or NONE


class Cat048(RecordReader):
    """Monoradar target reports."""

    def __init__(self) -> None:
        super().__init__(48)
        names = ("010", "140", "020", "040", "042", "070", "090", "110", "130", "220", "240")
        self._items = tuple(self._place[name] for name in names)

    def _message(self, data: bytes, begins: list[int], counts: Counter[str]) -> Plot | None:
        at010, at140, at020, at040, at042, at070, at090, at110, at130, at220, at240 = [
            begins[place] for place in self._items
        ]
        kind, fault = _descriptor_048(data, at020)
        if fault or at010 < 0:
            counts[fault or "no_radar"] += 1
            return None
        if at040 >= 0:
            distance = _word(data, at040) * (NAUTICAL_MILE / 256.0)
            azimuth = _word(data, at040 + 2) * AZIMUTH_UNIT
        elif at042 >= 0:
            distance, azimuth = _of_plane(data, at042)
        else:
            counts["no_position"] += 1
            return None
        height = _level(data, at090)
        if at110 >= 0 and math.isnan(height):
            height = _quarters(data, at110)
        primary, secondary = _amplitudes(data, at130)
        return Plot(
            _word(data, at010),
            _time_of_day(data, at140),
            DAY,
            distance,
            azimuth,
            height,
            _code(data, at070),
            _address(data, at220),
            kind,
            primary,
            secondary,
            call_signs.read(data, at240),
        )


def _descriptor_048(data: bytes, at: int) -> tuple[int, str]:
    """Return the kind of a plot, and the reason for skipping it, if there is one."""
    if at < 0:
        return 0, ""
    first = data[at]
    kind = first >> 5
    if kind == NO_DETECTION:
        return kind, "no_detection"
    if first & 0x02:
        return kind, "field_monitor"
    if first & 1 and data[at + 1] & 0x80:
        return kind, "test_target"
    return kind, ""


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


class Cat001(RecordReader):
    """Monoradar target reports of old radars; their times have 16 bits only."""

    def __init__(self) -> None:
        super().__init__(1)
        self._plots, self._tracks = self._layouts["plot"], self._layouts["track"]

    def read(
        self, data: bytes, at: int, limit: int, counts: Counter[str]
    ) -> tuple[Message | None, int]:
        """Return the plot of the record at `at`, None if it is skipped, and the record's end."""
        # The first bit of item 020 selects the layout; both layouts have this item at the same
        # place.
        kind = self._plots.first(data, at, limit, "020")
        layout = self._tracks if kind >= 0 and data[kind] & 0x80 else self._plots
        found, end = layout.walk(data, at, limit)
        self._place = layout.place
        return self._message(data, found, counts), end

    def _message(self, data: bytes, begins: list[int], counts: Counter[str]) -> Plot | None:
        items = {name: begins[place] for name, place in self._place.items()}
        radar, at020, at040 = self._radar(data, begins), items["020"], items["040"]
        first = data[at020] if at020 >= 0 else 0
        kind = first >> 4 & 3
        fault = ""
        if radar == NONE:
            fault = "no_radar"
        elif at040 < 0:
            fault = "no_position"
        elif at020 >= 0 and not kind:
            fault = "no_detection"
        elif first & 0x02:
            fault = "field_monitor"
        elif first & 1 and data[at020 + 1] & 0x80:
            fault = "test_target"
        if fault:
            counts[fault] += 1
            return None
        at141, at131 = items["141"], items["131"]
        power = math.nan if at131 < 0 else float(_signed(data[at131]))
        return Plot(
            radar,
            NONE if at141 < 0 else _word(data, at141),
            TRUNCATED,
            _word(data, at040) * (NAUTICAL_MILE / 128.0),
            _word(data, at040 + 2) * AZIMUTH_UNIT,
            _level(data, items["090"]),
            _code(data, items["070"]),
            NONE,
            kind,
            power if kind in (PRIMARY, COMBINED) else math.nan,
            power if kind == SECONDARY else math.nan,
        )


# Kinds of surface reports (I010/020), as the corresponding kinds of I048/020.
_SURFACE = {0: SECONDARY, 1: ROLL_CALL, 3: PRIMARY}


class Cat010(RecordReader):
    """Monosensor surface movement reports; ranges are in metres."""

    def __init__(self) -> None:
        super().__init__(10)

    def _message(self, data: bytes, begins: list[int], counts: Counter[str]) -> Plot | None:
        items = {name: begins[place] for name, place in self._place.items()}
        radar, at000, at020 = self._radar(data, begins), items["000"], items["020"]
        if at000 >= 0 and data[at000] != 1:
            return None  # an update cycle begins, or the sensor's state
        first = data[at020] if at020 >= 0 else 0xE0
        second = data[at020 + 1] if at020 >= 0 and first & 1 else 0
        fault = ""
        if radar == NONE:
            fault = "no_radar"
        elif items["040"] < 0:
            fault = "no_position"
        elif second & 0x20:
            fault = "field_monitor"
        elif second & 0x40:
            fault = "test_target"
        if fault:
            counts[fault] += 1
            return None
        height = _level(data, items["090"])
        return Plot(
            radar,
            _time_of_day(data, items["140"]),
            DAY,
            float(_word(data, items["040"])),
            _word(data, items["040"] + 2) * AZIMUTH_UNIT,
            height,
            _code(data, items["060"]),
            _address(data, items["220"]),
            _SURFACE.get(first >> 5, 0),
            math.nan,
            math.nan,
        )


class Service(RecordReader):
    """North marks and sector crossings of CAT034, and of CAT002 of old radars, which is similar."""

    def _message(
        self, data: bytes, begins: list[int], counts: Counter[str]
    ) -> ServiceMessage | None:
        at000, at020, at030, at041 = (
            begins[self._place[name]] for name in ("000", "020", "030", "041")
        )
        radar = self._radar(data, begins)
        if radar == NONE or at000 < 0:
            counts["no_radar" if radar == NONE else "no_kind"] += 1
            return None
        kind, azimuth = data[at000], math.nan
        if kind == NORTH:
            azimuth = 0.0
        elif kind == SECTOR and at020 >= 0:
            azimuth = data[at020] * SECTOR_UNIT
        turn = _word(data, at041) / TICKS_PER_S if at041 >= 0 else 0.0
        at120 = begins[self._place["120"]] if "120" in self._place else NONE
        return ServiceMessage(
            radar, _time_of_day(data, at030), kind, azimuth, turn or math.nan, _site(data, at120)
        )


def _site(data: bytes, at: int) -> tuple[float, float, float] | None:
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


@cache
def reader(category: int) -> RecordReader | None:
    """Return the decoder of a category, None if the category is not supported."""
    if category in (2, 34):
        return Service(category)
    kinds: dict[int, Callable[[], RecordReader]] = {1: Cat001, 10: Cat010, 48: Cat048}
    return kinds[category]() if category in kinds else None
