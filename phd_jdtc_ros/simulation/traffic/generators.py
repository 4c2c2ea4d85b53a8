"""The blocks of a scenario document that generate targets: ``traffic`` and ``manoeuvres``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, Parameter
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db

from ..checked import names_of, take
from .flight import Flight, Leg
from .geodesy import METRES_PER_NM, MPS_PER_KT, STANDARD_GRAVITY, east_north
from .traffic import STRAIGHT_S, TURN_DEG, Traffic, draw

SNR = Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0)
TRAFFIC = (
    Parameter("aircraft", 0, "Number of aircraft in the air.", 0, 10**4),
    Parameter("taxiing", 0, "Number of aircraft that taxi.", 0, 10**4),
    Parameter("entering", 0, "Number of aircraft that enter over the edge.", 0, 10**4),
    Parameter("seed", 0, "Seed of the random generator.", 0, 2**31 - 1),
    Parameter("centre", [0.0, 0.0], "Reference point of the airfield, world frame, m.", length=2),
    Parameter("radius", 105e3, "Aircraft end at this distance from the centre, m.", 1e4, 1e6),
    Parameter(
        "straight_s",
        list(STRAIGHT_S),
        "Shortest and longest straight flight between turns, s.",
        1.0,
        1e5,
        length=2,
    ),
    Parameter("turn_deg", list(TURN_DEG), "Least and largest turn, degrees.", 0.1, 360.0, length=2),
    SNR,
)
MANOEUVRES = (
    Parameter("straight_nm", 20.0, "Length of the straight legs, NM.", SMALL, 1e4),
    Parameter("turn_deg", 175.0, "Angle of the turns, clockwise, degrees.", -360.0, 360.0),
    Parameter("heading_deg", 0.0, "First heading, clockwise from north, degrees.", -360.0, 360.0),
    SNR,
)
FLIGHT = Parameter("", [0.0] * 4, "Speed, bank, latitude and longitude.", -180.0, 1e3, length=4)
# The turn rate, proportional to tan(bank), is unbounded at a right angle.
MOST_BANK_DEG = 85.0


def traffic(given: Mapping[str, Any], duration_s: float, faults: list[str]) -> Sequence[Flight]:
    """Return the flights of a ``traffic`` block; add its faults to `faults`."""
    found: list[str] = []
    values = take(TRAFFIC, given, "traffic.", found, names_of(TRAFFIC))
    if found or duration_s <= 0.0:
        faults += found
        return ()
    return draw(
        Traffic(
            aircraft=values["aircraft"],
            taxiing=values["taxiing"],
            seed=values["seed"],
            centre=tuple(values["centre"]),
            radius=values["radius"],
            duration_s=duration_s,
            snr=snr_from_db(values["snr_db"]),
            entering=values["entering"],
            straight_s=(min(values["straight_s"]), max(values["straight_s"])),
            turn_deg=(min(values["turn_deg"]), max(values["turn_deg"])),
        )
    )


def manoeuvres(
    given: Mapping[str, Any],
    origin: tuple[float, float],
    duration_s: float,
    faults: list[str],
) -> Sequence[Flight]:
    """Return the flights of a ``manoeuvres`` block; add its faults to `faults`.

    Each target alternates straight legs and turns for the whole run. A row of ``flights`` is a
    speed (kt), a bank (degrees), a latitude and a longitude (degrees).
    """
    found: list[str] = []
    values = take(MANOEUVRES, given, "manoeuvres.", found, names_of(MANOEUVRES), ("flights",))
    rows = given.get("flights", [])
    for index, row in enumerate(rows if isinstance(rows, list) else [rows]):
        checked = FLIGHT.coerce(row)
        if not isinstance(checked, list) or not _flyable(*checked[:2]):
            found.append(
                f"manoeuvres.flights[{index}]: {row!r} given, must be a speed above 0 kt, a bank "
                f"above 0 and at most {MOST_BANK_DEG:g} degrees, a latitude and a longitude"
            )
    if found or duration_s <= 0.0:
        faults += found
        return ()
    return tuple(_race(values, row, origin, duration_s) for row in rows)


def _flyable(speed_kt: float, bank_deg: float) -> bool:
    return speed_kt > 0.0 and 0.0 < bank_deg <= MOST_BANK_DEG


def _race(
    values: Mapping[str, Any],
    row: Sequence[float],
    origin: tuple[float, float],
    duration_s: float,
) -> Flight:
    """Return the flight of a row; its rate of turn is g tan(bank) / speed."""
    speed = row[0] * MPS_PER_KT
    rate = STANDARD_GRAVITY * math.tan(math.radians(row[1])) / speed
    angle = math.radians(values["turn_deg"])
    straight = Leg(values["straight_nm"] * METRES_PER_NM / speed)
    turn = Leg(abs(angle) / rate, -math.copysign(rate, angle)) if angle else straight
    legs, left_s = [], duration_s
    for leg in cycle((straight, turn)):
        if left_s <= leg.duration_s:
            break
        legs.append(leg)
        left_s -= leg.duration_s
    if left_s > 0.0:
        legs.append(Leg(left_s, leg.turn_rate))
    heading = math.radians(values["heading_deg"])
    return Flight(
        class_id=0,
        snr=snr_from_db(values["snr_db"]),
        start_s=0.0,
        position=east_north((row[2], row[3]), origin),
        velocity=(speed * math.sin(heading), speed * math.cos(heading)),
        legs=tuple(legs),
    )
