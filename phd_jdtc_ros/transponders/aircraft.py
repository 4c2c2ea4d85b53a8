"""Decodes aircraft: SBS-1, and ADS-B in frames of Mode S with rs1090.

SBS-1 are the lines of BaseStation that dump1090 and readsb send on port 30003. Its times are of the
sender's clock in the sender's time zone. It has no accuracies, and positions by multilateration
look like those of ADS-B.

A position of Mode S is the pair of an even and an odd frame, or one frame near a known place.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import cache
from typing import Any

from .messages import FOOT, ICAO, KNOT, NONE, NOT_SAID, OTHER, UNKNOWN_STD, Heard, of_nacp


def read_sbs(line: bytes) -> Heard | str:
    """Return what a line says, or why it is not used: ``malformed`` or ``other_message``."""
    # Zones differ by quarters of an hour.
    zone_ns = 900 * 10**9
    sbs_fields = 22
    cells = line.decode("ascii", "replace").split(",")
    if cells[0] not in ("MSG", "MLAT"):
        return "other_message"
    if len(cells) != sbs_fields:
        return "malformed"
    # Addresses that are not ICAO's have a mark of readsb.
    sender = cells[4].strip()
    space, digits = (OTHER, sender[1:]) if sender.startswith("~") else (ICAO, sender)
    try:
        height, speed, course, latitude, longitude = map(_number, cells[11:16])
        return Heard(
            space,
            int(digits, 16),
            _time(cells[6], cells[7]),
            zone_ns,
            latitude,
            longitude,
            speed * KNOT,
            course,
            height=height * FOOT,
            x_std=UNKNOWN_STD,
            y_std=UNKNOWN_STD,
            name=cells[10].strip(),
        )
    except ValueError:
        return "malformed"


def _number(text: str) -> float:
    """Return a number, NaN for an empty cell; raise `ValueError` for another text."""
    value = float(text) if text.strip() else math.nan
    if math.isinf(value):
        raise ValueError(text)
    return value


def _time(day: str, time: str) -> int:
    """Return a time as if of UTC, `NONE` for empty cells."""
    if not (day.strip() and time.strip()):
        return NONE
    found = datetime.strptime(f"{day.strip()} {time.strip()[:12]}", "%Y/%m/%d %H:%M:%S.%f")
    return round(found.replace(tzinfo=timezone.utc).timestamp() * 1e3) * 10**6


# Frames of a pair are at most this far apart, and a place is a reference for this long.
PAIR_NS, PLACE_NS = 10 * 10**9, 30 * 10**9
# Formats with an extended squitter; the control field of the second one tells ADS-B from what
# ground stations say of radars' targets (TIS-B).
_SQUITTER, _NON_TRANSPONDER = 17, 18
_AIRBORNE, _SURFACE, _IDENTITY, _VELOCITY = "05", "06", "08", "09"


@dataclass
class _Aircraft:
    """The latest frames of a transmitter, and where it was."""

    frames: dict[str, tuple[str, int]] = field(default_factory=dict)  # By parity, with their time
    place: tuple[float, float] | None = None
    place_ns: int = 0
    std: tuple[float, int] = (UNKNOWN_STD, NOT_SAID)


class ModeSReader:
    """Decodes frames; `counts` gains ``other_message``, ``malformed`` and ``surface_unplaced``.

    The last are positions on the ground without a place near them: of the aircraft before it
    landed, or `position`, latitude and longitude of the receiver.
    """

    MOST_ADDRESSES = 10_000
    _OF_ICAO = (0, 6)

    def __init__(self, counts: Counter[str], position: tuple[float, float] | None = None) -> None:
        self.counts = counts
        self._position = position
        self._aircraft: OrderedDict[tuple[int, int], _Aircraft] = OrderedDict()

    def read(self, frame: bytes, now_ns: int) -> Heard | None:
        """Return what a frame says at a time; frames of a pair are told by it."""
        # Emitter categories by type code and category, as I021/020 counts them.
        categories = {
            4: {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 6, 7: 10},
            3: {1: 11, 2: 12, 3: 16, 4: 15, 6: 13, 7: 14},
            2: {1: 20, 2: 21, 3: 22, 4: 23, 5: 24},
        }
        kind = frame[0] >> 3
        if kind not in (_SQUITTER, _NON_TRANSPONDER) or len(frame) != 14:
            self.counts["other_message"] += 1
            return None
        digits = frame.hex()
        found: Any = _decoder()(digits)
        if found is None:  # Its parity is wrong
            self.counts["malformed"] += 1
            return None
        own = kind == _SQUITTER or frame[0] & 7 in self._OF_ICAO
        space, address = ICAO if own else OTHER, int(found["icao24"], 16)
        aircraft = self._of(space, address)
        if found.get("NACp") is not None:
            aircraft.std = of_nacp(int(found["NACp"]))
        heard = Heard(space, address)
        if found.get("bds") in (_AIRBORNE, _SURFACE):
            return self._located(heard, aircraft, digits, found, now_ns)
        if found.get("bds") == _VELOCITY:
            return heard._replace(
                speed=_known(found, "groundspeed") * KNOT, course=_known(found, "track")
            )
        if found.get("bds") == _IDENTITY:
            code, category = frame[4] >> 3, frame[4] & 7
            return heard._replace(
                name=str(found.get("callsign") or "").strip(" _"),
                type=categories.get(code, {}).get(category, 0),
            )
        if found.get("NACp") is None:
            self.counts["other_message"] += 1
        return None

    def _of(self, space: int, address: int) -> _Aircraft:
        aircraft = self._aircraft.pop((space, address), None) or _Aircraft()
        self._aircraft[space, address] = aircraft
        if len(self._aircraft) > self.MOST_ADDRESSES:
            self._aircraft.popitem(last=False)
        return aircraft

    def _located(
        self, heard: Heard, aircraft: _Aircraft, digits: str, found: Any, now_ns: int
    ) -> Heard | None:
        recent = abs(now_ns - aircraft.place_ns) <= PLACE_NS
        place = aircraft.place if recent else None
        if found["bds"] == _SURFACE:
            near = place or self._position
            if near is None:
                self.counts["surface_unplaced"] += 1
                return None
            placed = _decoder()(digits, reference=near)
        else:
            placed = self._airborne(aircraft, digits, found["parity"], place, now_ns)
        latitude, longitude = _known(placed, "latitude"), _known(placed, "longitude")
        if math.isnan(latitude):  # The other frame has not come yet
            return None
        aircraft.place, aircraft.place_ns = (latitude, longitude), now_ns
        std, accurate = aircraft.std
        return heard._replace(
            latitude=latitude,
            longitude=longitude,
            speed=_known(found, "groundspeed") * KNOT,
            course=_known(found, "track"),
            height=_known(found, "altitude") * FOOT,
            x_std=std,
            y_std=std,
            accurate=accurate,
        )

    def _airborne(
        self,
        aircraft: _Aircraft,
        digits: str,
        parity: str,
        place: tuple[float, float] | None,
        now_ns: int,
    ) -> Any:
        """Return a frame decoded with the other one of its pair, or else near a place."""
        aircraft.frames[parity] = digits, now_ns
        other, other_ns = aircraft.frames.get("odd" if parity == "even" else "even", ("", 0))
        if other and 0 <= now_ns - other_ns <= PAIR_NS:
            return _decoder()([other, digits], [other_ns * 1e-9, now_ns * 1e-9])[-1]
        return {} if place is None else _decoder()(digits, reference=place)


@cache
def _decoder() -> Any:
    """Import rs1090 when the first frame comes; raise `ModuleNotFoundError` without it."""
    from rs1090 import decode

    return decode


def _known(found: Any, name: str) -> float:
    value = found.get(name)
    return math.nan if value is None else float(value)
