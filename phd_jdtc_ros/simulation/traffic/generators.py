"""The blocks of a scenario document that generate targets: ``traffic`` and ``manoeuvres``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, Parameter, parameter

from ..checked import degrees, read, signal_to_noise
from .flight import Flight, Leg
from .geodesy import METRES_PER_NM, MPS_PER_KT, STANDARD_GRAVITY, east_north
from .traffic import Traffic, draw


@dataclass(frozen=True)
class Manoeuvres:
    """The block ``manoeuvres`` without its list of flights."""

    straight_nm: float = parameter(20.0, "Length of the straight legs, NM.", (SMALL, 1e4))
    turn: float = degrees(
        175.0, "Angle of the turns, clockwise, degrees.", (-360.0, 360.0), "turn_deg"
    )
    heading: float = degrees(
        0.0, "First heading, clockwise from north, degrees.", (-360.0, 360.0), "heading_deg"
    )
    snr: float = signal_to_noise(30.0)


FLIGHT = Parameter("", [0.0] * 4, "Speed, bank, latitude and longitude.", -180.0, 1e3, length=4)
# The turn rate, proportional to tan(bank), is unbounded at a right angle.
MOST_BANK_DEG = 85.0


def traffic(given: Mapping[str, Any], duration_s: float, faults: list[str]) -> Sequence[Flight]:
    """Return the flights of a ``traffic`` block; add its faults to `faults`."""
    found = read(Traffic, given, "traffic.", faults, duration_s=duration_s)
    return draw(found) if found and duration_s > 0.0 else ()


def manoeuvres(
    given: Mapping[str, Any], origin: tuple[float, float], duration_s: float, faults: list[str]
) -> Sequence[Flight]:
    """Return the flights of a ``manoeuvres`` block; add its faults to `faults`.

    Each target alternates straight legs and turns for the whole run. A row of ``flights`` is a
    speed (kt), a bank (degrees), a latitude and a longitude (degrees).
    """
    found: list[str] = []
    repeated = read(Manoeuvres, given, "manoeuvres.", found, ("flights",))
    rows = given.get("flights", [])
    for index, row in enumerate(rows if isinstance(rows, list) else [rows]):
        speed, bank, *_ = FLIGHT.coerce(row) or (0.0, 0.0)
        if not (speed > 0.0 and 0.0 < bank <= MOST_BANK_DEG):
            found.append(
                f"manoeuvres.flights[{index}]: {row!r} given, must be a speed above 0 kt, a bank "
                f"above 0 and at most {MOST_BANK_DEG:g} degrees, a latitude and a longitude"
            )
    faults += found
    if repeated is None or found or duration_s <= 0.0:
        return ()
    return tuple(_racetrack(repeated, row, origin, duration_s) for row in rows)


def _racetrack(
    repeated: Manoeuvres, row: Sequence[float], origin: tuple[float, float], duration_s: float
) -> Flight:
    """Return the racetrack of a row; its rate of turn is g tan(bank) / speed."""
    speed = row[0] * MPS_PER_KT
    rate = STANDARD_GRAVITY * math.tan(math.radians(row[1])) / speed
    straight = Leg(repeated.straight_nm * METRES_PER_NM / speed)
    turn = (
        Leg(abs(repeated.turn) / rate, -math.copysign(rate, repeated.turn))
        if repeated.turn
        else straight
    )
    legs, left_s = [], duration_s
    for leg in cycle((straight, turn)):
        if left_s <= leg.duration_s:
            break
        legs.append(leg)
        left_s -= leg.duration_s
    if left_s > 0.0:
        legs.append(Leg(left_s, leg.turn_rate))
    return Flight(
        class_id=0,
        snr=repeated.snr,
        start_s=0.0,
        position=east_north((row[2], row[3]), origin),
        velocity=(speed * math.sin(repeated.heading), speed * math.cos(repeated.heading)),
        legs=tuple(legs),
    )
