"""Random air traffic around an airfield: arrivals, departures, overflights, taxiing aircraft.

The world is a plane: climbs and descents change the speed, not the height.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, Parameter, parameter

from .checked import converted_parameter, degrees, pair, read, signal_to_noise
from .targets import (
    METRES_PER_NM,
    MPS_PER_KT,
    ROUNDING_S,
    STANDARD_GRAVITY,
    Flight,
    Leg,
    east_north,
)

# Shares of arrivals and of departures among the aircraft in the air; the others fly over.
ARRIVALS, DEPARTURES = 0.4, 0.3
# Speeds at take-off and landing, in the terminal area, and en route, metres per second.
RUNWAY_SPEED, TERMINAL_SPEED, CRUISE_SPEED = (65.0, 80.0), (110.0, 150.0), (190.0, 250.0)
# Times at the first two of these speeds, seconds.
RUNWAY_S, TERMINAL_S = (20.0, 50.0), (60.0, 180.0)
# Turns: bank and angle in degrees, straight flight between turns in seconds, and the rate of a
# standard turn, the upper bound, in degrees per second.
BANK_DEG, TURN_DEG, STRAIGHT_S, STANDARD_DEG_S = (15.0, 27.0), (15.0, 110.0), (30.0, 150.0), 3.0
# Taxiing: speed in m/s, acceleration in m/s^2, times of a turn, of a straight part and at a holding
# point in seconds, and largest distance from the reference point in metres.
TAXI_SPEED, TAXI_ACCELERATION, TAXI_TURN_S = (5.0, 10.0), 1.0, 6.0
TAXI_STRAIGHT_S, HOLD_S, APRON = (15.0, 50.0), (10.0, 45.0), 1500.0
# Time that suffices to leave the radius, seconds.
LONGEST_S = 3600.0

Range = tuple[float, float]


def _order(pair: Sequence[float]) -> Range:
    return min(pair), max(pair)


@dataclass(frozen=True)
class Traffic:
    """The distribution of random traffic; the block ``traffic`` of a scenario document."""

    aircraft: int = parameter(0, "Number of aircraft in the air.", (0, 10**4))
    taxiing: int = parameter(0, "Number of aircraft that taxi.", (0, 10**4))
    entering: int = parameter(0, "Number of aircraft that enter over the edge.", (0, 10**4))
    seed: int = parameter(0, "Seed of the random generator.", (0, 2**31 - 1))
    centre: tuple[float, float] = pair("Reference point of the airfield, world frame, m.")
    radius: float = parameter(
        105e3, "Aircraft end at this distance from the centre, m.", (1e4, 1e6)
    )
    straight_s: Range = converted_parameter(
        list(STRAIGHT_S),
        "Shortest and longest straight flight between turns, s.",
        (1.0, 1e5),
        _order,
        length=2,
    )
    turn_deg: Range = converted_parameter(
        list(TURN_DEG), "Least and largest turn, degrees.", (0.1, 360.0), _order, length=2
    )
    snr: float = signal_to_noise(30.0)
    duration_s: float = 0.0  # Length of the run


def draw(traffic: Traffic) -> tuple[Flight, ...]:
    """Return the aircraft: in the air, taxiing, entering; the flights depend on `traffic` only.

    Each aircraft has its own generator, so that more aircraft do not change the others.
    """
    kinds = (
        (traffic.aircraft, _in_the_air),
        (traffic.taxiing, _taxiing),
        (traffic.entering, _entering),
    )
    return tuple(
        draw_one(traffic, np.random.default_rng([traffic.seed, kind, number]))
        for kind, (count, draw_one) in enumerate(kinds)
        for number in range(count)
    )


def _in_the_air(traffic: Traffic, rng: np.random.Generator) -> Flight:
    kind = rng.random()
    if kind >= ARRIVALS + DEPARTURES:
        return _overflight(traffic, rng)
    flight = _within(traffic, _climb(traffic, rng))
    length_s = flight.end_s - flight.start_s
    if kind < ARRIVALS:
        flight = _reverse(flight)
    # The flight may begin before the run or end after it, but covers at least a quarter of it.
    overlap_s = min(0.25 * traffic.duration_s, length_s)
    start_s = rng.uniform(overlap_s - length_s, traffic.duration_s - overlap_s)
    return _cut(replace(flight, start_s=start_s), 0.0, traffic.duration_s)


def _climb(traffic: Traffic, rng: np.random.Generator) -> Flight:
    """Return a flight that takes off at 0 s, accelerates in two steps and leaves the area."""
    speeds = [rng.uniform(*limits) for limits in (RUNWAY_SPEED, TERMINAL_SPEED, CRUISE_SPEED)]
    # Change of speed in a climb or descent, m/s^2.
    acceleration = rng.uniform(0.25, 0.7)
    legs = [
        Leg(rng.uniform(*RUNWAY_S)),
        Leg((speeds[1] - speeds[0]) / acceleration, acceleration=acceleration),
        *_vectors(traffic, rng, speeds[1], rng.uniform(*TERMINAL_S)),
        Leg((speeds[2] - speeds[1]) / acceleration, acceleration=acceleration),
        *_vectors(traffic, rng, speeds[2], LONGEST_S),
    ]
    # Take-offs and landings are within this distance of the field's reference point, metres.
    return _anywhere(traffic, rng, 1000.0, speeds[0], legs)


def _overflight(traffic: Traffic, rng: np.random.Generator) -> Flight:
    speed = rng.uniform(*CRUISE_SPEED)
    legs = list(_vectors(traffic, rng, speed, LONGEST_S))
    flight = _anywhere(traffic, rng, 0.9 * traffic.radius, speed, legs)
    return _cut(_within(traffic, flight), 0.0, traffic.duration_s)


def _entering(traffic: Traffic, rng: np.random.Generator) -> Flight:
    """Return an overflight from one edge to another, which begins at any time of the run."""
    speed, bearing = rng.uniform(*CRUISE_SPEED), rng.uniform(-np.pi, np.pi)
    # An aircraft that enters over the edge heads for the field within this angle, radians.
    inward = bearing + np.pi + rng.uniform(-1.0, 1.0) * 0.8
    # A start exactly on the edge would count as having left.
    place = traffic.radius - 1.0, bearing
    legs = _vectors(traffic, rng, speed, LONGEST_S)
    flight = _within(traffic, _flight(traffic, place, speed, inward, legs))
    start_s = rng.uniform(-flight.end_s, traffic.duration_s)
    return _cut(replace(flight, start_s=start_s), 0.0, traffic.duration_s)


def _taxiing(traffic: Traffic, rng: np.random.Generator) -> Flight:
    """Return an aircraft on the ground: straight, right-angled turns, stops at holding points."""
    speed = rng.uniform(*TAXI_SPEED)
    braking_s = speed / TAXI_ACCELERATION
    legs: list[Leg] = []
    while sum(leg.duration_s for leg in legs) < traffic.duration_s:
        legs.append(Leg(rng.uniform(*TAXI_STRAIGHT_S)))
        if rng.random() < 0.5:
            legs.append(Leg(TAXI_TURN_S, rng.choice([-0.5, 0.5]) * np.pi / TAXI_TURN_S))
        else:
            legs += [
                Leg(braking_s, acceleration=-TAXI_ACCELERATION),
                Leg(rng.uniform(*HOLD_S)),
                Leg(braking_s, acceleration=TAXI_ACCELERATION),
            ]
    return _cut(_anywhere(traffic, rng, APRON, speed, legs), 0.0, traffic.duration_s)


def _vectors(
    traffic: Traffic, rng: np.random.Generator, speed: float, duration_s: float
) -> Iterator[Leg]:
    """Yield straight legs and turns in alternation, for at least this long."""
    flown_s = 0.0
    while flown_s < duration_s:
        bank = np.radians(rng.uniform(*BANK_DEG))
        rate = min(STANDARD_GRAVITY * np.tan(bank) / speed, np.radians(STANDARD_DEG_S))
        angle = np.radians(rng.uniform(*traffic.turn_deg))
        side = rng.choice([-1.0, 1.0])
        for leg in (Leg(rng.uniform(*traffic.straight_s)), Leg(angle / rate, side * rate)):
            flown_s += leg.duration_s
            yield leg


def _anywhere(
    traffic: Traffic, rng: np.random.Generator, apart: float, speed: float, legs: Sequence[Leg]
) -> Flight:
    """Return a flight from a random point within a distance of the centre, at 0 s."""
    distance = apart * np.sqrt(rng.random())
    bearing, course = rng.uniform(-np.pi, np.pi, 2)
    return _flight(traffic, (distance, bearing), speed, course, legs)


def _flight(
    traffic: Traffic, place: tuple[float, float], speed: float, course: float, legs: Iterable[Leg]
) -> Flight:
    """Return a flight from a distance and a bearing of the centre, at 0 s."""
    (distance, bearing), (x, y) = place, traffic.centre
    position = float(x + distance * np.cos(bearing)), float(y + distance * np.sin(bearing))
    velocity = float(speed * np.cos(course)), float(speed * np.sin(course))
    return Flight(0, traffic.snr, 0.0, position, velocity, tuple(legs))


def _within(traffic: Traffic, flight: Flight) -> Flight:
    """Return a flight until it leaves the radius for the first time."""
    seconds = np.arange(flight.start_s, flight.end_s, 1.0)
    position = flight.states(seconds)[:, [0, 2]]
    outside = np.hypot(*(position - traffic.centre).T) > traffic.radius
    return _cut(flight, flight.start_s, seconds[np.argmax(outside)] if outside.any() else np.inf)


def _cut(flight: Flight, first_s: float, last_s: float) -> Flight:
    ends = flight.start_s + np.cumsum([leg.duration_s for leg in flight.legs])
    begins = np.concatenate([[flight.start_s], ends[:-1]])
    parts = np.minimum(ends, last_s) - np.maximum(begins, first_s)
    legs = tuple(
        replace(leg, duration_s=float(part))
        for leg, part in zip(flight.legs, parts, strict=True)
        if part > ROUNDING_S
    )
    start_s = max(flight.start_s, first_s)
    x, vx, y, vy, _ = flight.states(np.array([start_s]))[0].tolist()
    return replace(flight, start_s=start_s, position=(x, y), velocity=(vx, vy), legs=legs)


def _reverse(flight: Flight) -> Flight:
    """Return a flight along the same path in the opposite direction, at the same speeds."""
    x, vx, y, vy, _ = flight.states(np.array([flight.end_s]))[0].tolist()
    legs = tuple(
        Leg(leg.duration_s, -leg.turn_rate, -leg.acceleration) for leg in reversed(flight.legs)
    )
    return replace(flight, position=(x, y), velocity=(-vx, -vy), legs=legs)


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
    # The turn rate, proportional to tan(bank), is unbounded at a right angle.
    most_bank_deg = 85.0
    found: list[str] = []
    repeated = read(Manoeuvres, given, "manoeuvres.", found, ("flights",))
    rows = given.get("flights", [])
    for index, row in enumerate(rows if isinstance(rows, list) else [rows]):
        speed, bank, *_ = FLIGHT.coerce(row) or (0.0, 0.0)
        if not (speed > 0.0 and 0.0 < bank <= most_bank_deg):
            found.append(
                f"manoeuvres.flights[{index}]: {row!r} given, must be a speed above 0 kt, a bank "
                f"above 0 and at most {most_bank_deg:g} degrees, a latitude and a longitude"
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
