"""Decodes AIS in sentences of NMEA 0183 with pyais: ships' positions, names, types and dimensions.

A sentence may follow a tag block with the time of its receipt (``c``) and the station (``s``), or
seconds since 1970 that a logger put before it, or after it with a comma.
"""

from __future__ import annotations

import math
import re
from collections import Counter, OrderedDict
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple

from phd_jdtc_ros.transport.network import fits_stamp

from .messages import AIS, KNOT, MMSI, NONE, Heard

# A message has at most nine sentences; those of a message come within a few seconds.
LONGEST_WAIT_NS, MOST_WAITING = 10 * 10**9, 500
# Standard deviations on each axis with the flag of accuracy (within 10 m) and without, metres.
ACCURATE_STD, INACCURATE_STD = 4.0, 12.0
# Bits of each type up to the last field that is used: the rest of a cut message is zeros.
_BITS = {1: 143, 2: 143, 3: 143, 4: 78, 5: 270, 18: 139, 19: 301, 24: 160, 27: 94}
# Shortest intervals of positions by type, seconds: class A, class B, and long range (ITU-R M.1371).
_POSITIONS = {**dict.fromkeys((1, 2, 3), 2.0), **dict.fromkeys((18, 19), 30.0), 27: 180.0}
_STATIC = (5, 19, 24)
# Values of "not available": speed (knots), course and heading (degrees).
_NO_SPEED, _NO_COARSE_SPEED, _NO_COURSE, _NO_HEADING = 102.3, 63.0, 360.0, 511
_LINE = re.compile(
    rb"(?:(?P<before>\d{10}(?:\.\d+)?)[\s,;]+)?[^\\!$]*(?:\\(?P<tags>[^\\]*)\\)?"
    rb"(?P<sentence>[!$](?P<body>[^*]*)\*(?P<sum>[0-9A-Fa-f]{2}))(?:[^\\]*?,(?P<after>\d{10}))?.*",
    re.DOTALL,
)


class _Part(NamedTuple):
    """A sentence of a message of several."""

    sentence: bytes
    bits: int
    received_ns: int | None


class AisReader:
    """Decodes sentences; `counts` gains those that are left out, by reason.

    These are ``no_sentence`` (neither its form nor a checksum), ``checksum``, ``tag_checksum`` (the
    sentence is used), ``tag_time_off`` (its time is far from the receipt, and is not used),
    ``part_missing``, ``malformed``, ``other_sentence`` and ``other_type``.
    """

    def __init__(self, counts: Counter[str], max_offset_ns: int) -> None:
        self.counts = counts
        self._max_offset_ns = max_offset_ns
        # The sentences of incomplete messages, by source, station and the message's number.
        self._waiting: OrderedDict[tuple[Any, ...], dict[int, _Part]] = OrderedDict()

    def read(
        self, line: bytes, received_ns: int | None, source: str
    ) -> tuple[Heard, int | None] | None:
        """Return what the message says that a line completes, with its time of receipt."""
        found = _LINE.fullmatch(line)
        if found is None:
            self.counts["no_sentence"] += 1
            return None
        if _checksum(found["body"]) != int(found["sum"], 16):
            self.counts["checksum"] += 1
            return None
        fields = found["body"].split(b",")
        kind = fields[0][2:]
        if kind not in (b"VDM", b"VDO") or len(fields) != 7:
            self.counts["other_sentence"] += 1
            return None
        tags = self._tags(found["tags"])
        received_ns = self._receipt(found, tags, received_ns)
        parts = self._assembled(found["sentence"], fields, (source, tags.get(b"s")), received_ns)
        if not parts:
            return None
        heard = self._decode(parts, kind == b"VDO")
        return None if heard is None else (heard, parts[0].received_ns)

    def _tags(self, block: bytes | None) -> Mapping[bytes, bytes]:
        """Return the fields of a tag block, none if its checksum is wrong."""
        if not block:
            return {}
        body, _, checksum = block.partition(b"*")
        if checksum.upper() != b"%02X" % _checksum(body):
            self.counts["tag_checksum"] += 1
            return {}
        pairs = (entry.partition(b":") for entry in body.split(b","))
        return {key: value for key, _, value in pairs}

    def _receipt(
        self, found: re.Match[bytes], tags: Mapping[bytes, bytes], received_ns: int | None
    ) -> int | None:
        """Return the time of receipt that a line has itself, or else the given one."""
        text = tags.get(b"c") or found["before"] or found["after"]
        try:
            seconds = float(text or b"nan")
        except ValueError:
            seconds = math.nan
        if not 0.0 < seconds < 1e14:
            return received_ns
        # Some stations send milliseconds.
        own_ns = round(seconds * (1e6 if seconds > 1e11 else 1e9))
        if not fits_stamp(own_ns):
            return received_ns
        if received_ns is not None and abs(own_ns - received_ns) > self._max_offset_ns:
            self.counts["tag_time_off"] += 1
            return received_ns
        return own_ns

    def _assembled(
        self,
        sentence: bytes,
        fields: list[bytes],
        sender: tuple[str, bytes | None],
        received_ns: int | None,
    ) -> list[_Part]:
        """Return the sentences of a message in order once all are there, in whichever order."""
        try:
            count, number = int(fields[1]), int(fields[2])
            bits = 6 * len(fields[5]) - int(fields[6])
        except ValueError:
            count, number, bits = 0, 0, 0
        if not 1 <= number <= count <= 9:
            self.counts["malformed"] += 1
            return []
        part = _Part(sentence, bits, received_ns)
        if count == 1:
            return [part]
        # Channels differ in the parts of some receivers.
        key = (*sender, count, fields[3])
        parts = self._waiting.pop(key, {})
        old = next(iter(parts.values()), part)
        waited_ns = 0
        if received_ns is not None and old.received_ns is not None:
            waited_ns = received_ns - old.received_ns
        if number in parts or waited_ns > LONGEST_WAIT_NS:
            self.counts["part_missing"] += 1
            parts = {}
        parts[number] = part
        if len(parts) == count:
            return [parts[each] for each in range(1, count + 1)]
        self._waiting[key] = parts
        if len(self._waiting) > MOST_WAITING:
            self._waiting.popitem(last=False)
            self.counts["part_missing"] += 1
        return []

    def _decode(self, parts: list[_Part], own_ship: bool) -> Heard | None:
        from pyais import decode  # Here, so that it is imported when the first sentence comes

        try:
            message: Any = decode(*(part.sentence for part in parts))
            least = _BITS.get(message.msg_type, 0)
            heard = _heard(message, own_ship) if sum(part.bits for part in parts) >= least else None
        except Exception:  # It is refused in several ways.
            message = heard = None
        if message is None or (heard is None and message.msg_type in _BITS):
            self.counts["malformed"] += 1
            return None
        if heard is None:
            self.counts["other_type"] += 1
        return heard


def _checksum(body: bytes) -> int:
    found = 0
    for byte in body:
        found ^= byte
    return found


def _heard(message: Any, own_ship: bool) -> Heard | None:
    """Return what a message says, None if it is of another type."""
    kind = message.msg_type
    heard = Heard(MMSI, int(message.mmsi), network=AIS, own_ship=own_ship)
    if kind == 4:  # A base station
        return heard._replace(own_ns=_date(message), clock=True)
    if kind not in _POSITIONS and kind not in _STATIC:
        return None
    if kind in _POSITIONS:
        heard = _with_position(heard, message, kind == 27)
    if kind in _STATIC:
        heard = _with_ship(heard, message)
    return heard


def _with_position(heard: Heard, message: Any, coarse: bool) -> Heard:
    minute_ns = 60 * 10**9
    speed, course = float(message.speed), float(message.course)
    heading = _NO_HEADING if coarse else int(message.heading)
    second = NONE if coarse else int(message.second)
    std = ACCURATE_STD if message.accuracy else INACCURATE_STD
    if coarse:  # Rounded to a tenth of a minute
        std = math.hypot(std, 1852.0 / 10.0 / math.sqrt(12.0))
    known_speed = speed < (_NO_COARSE_SPEED if coarse else _NO_SPEED)
    return heard._replace(
        # Positions are of any time within their second.
        own_ns=second * 10**9 + 10**9 // 2 if 0 <= second < 60 else NONE,
        period_ns=0 if coarse else minute_ns,
        latitude=float(message.lat),
        longitude=float(message.lon),
        speed=speed * KNOT if known_speed else math.nan,
        course=course if course < _NO_COURSE else math.nan,
        heading=float(heading) if heading < 360 else math.nan,
        x_std=std,
        y_std=std,
        accurate=int(bool(message.accuracy)),
        interval_s=_POSITIONS[message.msg_type],
        long_range=coarse,
    )


def _with_ship(heard: Heard, message: Any) -> Heard:
    name = str(getattr(message, "shipname", "") or "").strip()
    found = heard._replace(name=name, type=int(getattr(message, "ship_type", 0) or 0))
    # Craft of a parent ship, 98, have its number in the place of their dimensions.
    if hasattr(message, "to_bow") and heard.address // 10**7 != 98:
        sides = (message.to_bow, message.to_stern, message.to_port, message.to_starboard)
        bow, stern, port, starboard = (int(side or 0) for side in sides)
        hull = (bow, stern, port, starboard) if any(sides) else None
        found = found._replace(hull=hull)
    return found


def _date(message: Any) -> int:
    """Return the time of a base station's report, `NONE` if it has none."""
    try:
        day = datetime(message.year, message.month, message.day, tzinfo=timezone.utc)
        time = timedelta(hours=message.hour, minutes=message.minute, seconds=message.second)
        return int((day + time).timestamp()) * 10**9
    except ValueError:
        return NONE
