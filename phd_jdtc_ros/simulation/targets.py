"""Targets by scan, and flights with legs in seconds, for radars without a common scan.

They are the block ``targets`` of a scenario document. In a gap of the block ``gaps`` a target is
hidden from all radars, by a hill, in the cone of silence, or with its transponder switched off. It
continues its flight and keeps its identity.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn

from .checked import (
    collecting_faults,
    degrees,
    mapping,
    mappings,
    pair,
    read,
    read_list,
    signal_to_noise,
)

# Tolerance of a flight's end, which is a sum of durations, at a scan's time.
ROUNDING_S = 1e-6


def turn_rate_field(**more: Any) -> Any:
    """Return a field of a turn rate in radians per second."""
    text = "Turn rate, counter-clockwise, degrees per second."
    return degrees(0.0, text, (-180.0, 180.0), "turn_rate_deg_s", **more)


@dataclass(frozen=True)
class Leg:
    """A part of a flight: straight, with a constant acceleration, or a turn at constant speed."""

    duration_s: float = parameter(0.0, "Length of the leg, s.", (SMALL, 1e7), required=True)
    turn_rate: float = turn_rate_field()
    acceleration: float = parameter(0.0, "Change of the speed, m/s^2.", (-1e3, 1e3))
    climb: float = parameter(0.0, "Climb rate, m/s, that radars in space see.", (-1e3, 1e3))

    def __post_init__(self) -> None:
        if not self.duration_s > 0.0:
            raise ConfigError(f"duration_s: {self.duration_s} given, must be above 0")
        if self.turn_rate and self.acceleration:
            raise ConfigError(f"acceleration: {self.acceleration} given, must be 0 in a turn")


@dataclass(frozen=True)
class Flight:
    """One target that exists from its start until its last leg ends."""

    class_id: int
    snr: float  # Mean signal-to-noise ratio, linear
    start_s: float  # Seconds after scan 0
    position: tuple[float, float]  # At the start, world frame, metres
    velocity: tuple[float, float]  # At the start, metres per second
    legs: tuple[Leg, ...]  # One after the other
    height: float = 0.0  # At the start, above the world's zero, metres

    def __post_init__(self) -> None:
        slowest = self._marks[:, 2].min()
        if slowest < -ROUNDING_S:
            raise ConfigError(f"legs: a speed of {slowest:.3g} m/s, expected none below 0")

    @property
    def end_s(self) -> float:
        """End of the last leg, seconds after scan 0."""
        return self.start_s + float(self._starts[-1])

    @property
    def end_velocity(self) -> tuple[float, float]:
        """Velocity at the end of the last leg, metres per second."""
        _, _, speed, course = self._marks[-1].tolist()
        return speed * math.cos(course), speed * math.sin(course)

    def state_at(self, elapsed_s: float) -> FloatArray | None:
        """Return the exact state at a time after scan 0, shape (D,); None if absent."""
        if not self.start_s - ROUNDING_S <= elapsed_s <= self.end_s + ROUNDING_S:
            return None
        state: FloatArray = self.states(np.array([elapsed_s]))[0]
        return state

    def states(self, time_s: FloatArray) -> FloatArray:
        """Return the exact states at times after scan 0; shape (N,) to (N, D).

        Before its start and after its end the target moves as in its first and last leg.
        """
        (x, y, speed, course), leg = self._at(time_s)
        state = np.zeros((len(leg), len(PLANAR)))
        state[:, list(PLANAR.position)] = np.stack([x, y], axis=1)
        state[:, list(PLANAR.velocity)] = np.stack(
            [speed * np.cos(course), speed * np.sin(course)], axis=1
        )
        state[:, PLANAR.turn_rate] = self._rates[leg, 0]
        return state

    def heights(self, time_s: FloatArray) -> FloatArray:
        """Return heights and climb rates at times after scan 0, m and m/s; shape (N,) to (N, 2)."""
        elapsed = np.asarray(time_s, dtype=np.float64) - self.start_s
        climbs = np.array([leg.climb for leg in self.legs])
        leg = np.clip(np.searchsorted(self._starts, elapsed, "right") - 1, 0, len(climbs) - 1)
        before = np.concatenate([[0.0], np.cumsum(climbs * np.diff(self._starts))])
        height = self.height + before[leg] + climbs[leg] * (elapsed - self._starts[leg])
        return np.stack([height, climbs[leg]], axis=1)

    def courses(self, time_s: FloatArray) -> FloatArray:
        """Return the headings at times after scan 0, radians, shape (N,); defined at rest too."""
        course: FloatArray = self._at(time_s)[0][3]
        return course

    def _at(self, time_s: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return x, y, speed and course, shape (4, N), and the legs at times after scan 0."""
        elapsed = np.asarray(time_s, dtype=np.float64) - self.start_s
        leg = np.clip(np.searchsorted(self._starts, elapsed, "right") - 1, 0, len(self.legs) - 1)
        return _move(self._marks[leg], self._rates[leg], elapsed - self._starts[leg]), leg

    @cached_property
    def _starts(self) -> FloatArray:
        """Start of each leg and end of the last one, seconds after the start; (legs + 1,)."""
        return np.concatenate([[0.0], np.cumsum([leg.duration_s for leg in self.legs])])

    @cached_property
    def _rates(self) -> FloatArray:
        """Turn rate and acceleration of each leg, shape (legs, 2)."""
        return np.array([[leg.turn_rate, leg.acceleration] for leg in self.legs])

    @cached_property
    def _marks(self) -> FloatArray:
        """x, y, speed and course at the start of each leg and the end of the last, (legs + 1, 4).

        The course is kept where the speed is 0.
        """
        vx, vy = self.velocity
        marks = np.array([[*self.position, math.hypot(vx, vy), math.atan2(vy, vx)]])
        for leg, rates in zip(self.legs, self._rates, strict=True):
            after = _move(marks[-1:], rates[None], np.array([leg.duration_s]))
            marks = np.concatenate([marks, after.T])
        return marks


def _move(mark: FloatArray, rates: FloatArray, elapsed: FloatArray) -> FloatArray:
    """Return x, y, speed and course some seconds after marks, shape (4, N)."""
    x, y, speed, course = mark.T
    turn_rate, acceleration = rates.T
    half = 0.5 * turn_rate * elapsed
    # A turn's chord is shorter than its arc by sin(half) / half.
    chord = (speed + 0.5 * acceleration * elapsed) * elapsed * np.sinc(half / np.pi)
    return np.stack(
        [
            x + chord * np.cos(course + half),
            y + chord * np.sin(course + half),
            speed + acceleration * elapsed,
            course + 2.0 * half,
        ]
    )


# Mean radius, metres.
EARTH_RADIUS = 6_371_008.8
METRES_PER_NM = 1852.0
MPS_PER_KT = METRES_PER_NM / 3600.0
STANDARD_GRAVITY = 9.80665


def east_north(place: tuple[float, float], origin: tuple[float, float]) -> tuple[float, float]:
    """Return a place's coordinates in the plane about an origin, metres east and north.

    Place and origin are latitudes and longitudes, degrees. The projection is the azimuthal
    equidistant one of a sphere: distances and bearings from the origin are true. 300 km from it,
    distances across are 0.04 % too long.
    """
    (north, east), (north_0, east_0) = (map(math.radians, point) for point in (place, origin))
    away = east - east_0
    across = math.cos(north) * math.sin(away)
    along = math.cos(north_0) * math.sin(north) - math.sin(north_0) * math.cos(north) * math.cos(
        away
    )
    up = math.sin(north_0) * math.sin(north) + math.cos(north_0) * math.cos(north) * math.cos(away)
    chord = math.hypot(across, along)
    scale = EARTH_RADIUS * (math.atan2(chord, up) / chord if chord else 1.0)
    return scale * across, scale * along


@dataclass(frozen=True)
class Gaps:
    """The block ``gaps``."""

    count: int = parameter(0, "Number of gaps in the run.", (0, 10**5))
    shortest_s: float = parameter(10.0, "Shortest duration of a gap, s.", (SMALL, 1e6))
    longest_s: float = parameter(120.0, "Longest duration of a gap, s.", (SMALL, 1e6))
    slowest: float = parameter(20.0, "Least initial speed of a target with a gap, m/s.", (0.0, 1e4))
    seed: int = parameter(0, "Seed of the choice of targets and times.", (0, 2**31 - 1))

    def __post_init__(self) -> None:
        if self.longest_s < self.shortest_s:
            raise ConfigError(
                f"longest_s: {self.longest_s:g} given, must be at least shortest_s, "
                f"{self.shortest_s:g}"
            )


class Gap(NamedTuple):
    """A time in which a target is out of sight."""

    number: int  # Number of the target, from 1
    start_s: float  # Seconds after scan 0
    end_s: float  # Seconds after scan 0


def in_gap(gaps: Sequence[Gap], number: int, time_s: FloatArray) -> BoolArray:
    """Return whether a target, by number from 1, is in a gap; same shape."""
    out = np.zeros(np.shape(time_s), dtype=np.bool_)
    for gap in gaps:
        if gap.number == number:
            out |= (time_s >= gap.start_s) & (time_s < gap.end_s)
    return out


def read_gaps(
    document: Mapping[str, object], flights: Sequence[Flight], faults: list[str]
) -> tuple[Gap, ...]:
    """Return the gaps of a document's ``gaps`` block, if any, in the flights of all its targets."""
    if "gaps" not in document:
        return ()
    found = read(Gaps, mapping(document, "gaps", faults), "gaps.", faults)
    return _draw(found, flights) if found else ()


def _draw(drawn: Gaps, flights: Sequence[Flight]) -> tuple[Gap, ...]:
    """Return gaps of random targets, drawn in proportion to the time that a gap can begin in."""
    # Least time in sight before and after a gap, seconds.
    apart_s = 60.0
    rng = np.random.default_rng(drawn.seed)
    speed = np.array([np.hypot(*flight.velocity) for flight in flights])
    life_s = np.array([flight.end_s - flight.start_s for flight in flights])
    free = speed >= drawn.slowest
    gaps: list[Gap] = []
    for _ in range(drawn.count):
        length_s = float(rng.uniform(drawn.shortest_s, drawn.longest_s))
        # Time in which a gap can begin; a target has at most one gap.
        spare = np.where(free, np.maximum(life_s - length_s - 2.0 * apart_s, 0.0), 0.0)
        if not spare.any():
            break
        row = int(rng.choice(len(flights), p=spare / spare.sum()))
        start_s = flights[row].start_s + apart_s + float(rng.uniform(0.0, spare[row]))
        gaps.append(Gap(row + 1, start_s, start_s + length_s))
        free[row] = False
    return tuple(gaps)


SCANS, HEIGHTS = (0, 10**6), (-1e4, 3e4)
# True targets follow this model's mean; turn rate 0 is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)


@dataclass(frozen=True)
class Turn:
    """A part of a target's life in which its velocity rotates at a constant rate."""

    # The turn lasts from the stamp of the first scan to that of the last, at which the target flies
    # straight again.
    first_scan: int = parameter(0, "Scan at which the turn begins.", SCANS, required=True)
    last_scan: int = parameter(0, "Scan at which the turn ends.", SCANS, required=True)
    turn_rate: float = turn_rate_field(required=True)


@dataclass(frozen=True)
class TargetScript:
    """One target that moves at constant velocity except in its turns."""

    class_id: int = parameter(0, "Class, from 0.", (0, 1000), required=True)
    snr: float = signal_to_noise(30.0, required=True)
    position: tuple[float, float] = pair(
        "Position at the first scan, world frame, m.", required=True
    )
    velocity: tuple[float, float] = pair(
        "Velocity at the first scan, world frame, m/s.", required=True
    )
    first_scan: int = parameter(0, "First scan in which the target exists.", SCANS, required=True)
    last_scan: int = parameter(0, "Last scan in which the target exists.", SCANS, required=True)
    turns: tuple[Turn, ...] = ()  # One after the other, none before the first scan
    height: float = parameter(0.0, "Height above the world's zero, m.", HEIGHTS)

    def __post_init__(self) -> None:
        faults = []
        first, last = self.first_scan, self.last_scan
        if last < first:
            faults = [f"last_scan: {last} given, must be at least first_scan, {first}"]
        event = "target appears"
        for index, turn in enumerate(() if faults else self.turns):
            begin, end = turn.first_scan, turn.last_scan
            if begin < first:
                faults.append(
                    f"turns[{index}].first_scan: {begin} given, must be at least {first}, when the "
                    f"{event}"
                )
            if not begin < end <= last:
                faults.append(
                    f"turns[{index}].last_scan: {end} given, must be above its first_scan, "
                    f"{begin}, and at most the target's last_scan, {last}"
                )
            first, event = end, "previous turn ends"
        if faults:
            raise ConfigError(*faults)

    def state_at(self, scan: int, interval_s: float) -> FloatArray | None:
        """Return the exact state at a scan, with the present turn's rate, (D,); None if absent.

        Scans are `interval_s` seconds apart.
        """
        if not self.first_scan <= scan <= self.last_scan:
            return None
        space = NOISE_FREE.space
        state = space.state(self.position, self.velocity, 0.0)[None]
        for scans, turn_rate in self._legs(scan):
            state[0, space.turn_rate] = turn_rate
            state = NOISE_FREE.mean(state, scans * interval_s)
        now = [turn.turn_rate for turn in self.turns if turn.first_scan <= scan < turn.last_scan]
        state[0, space.turn_rate] = sum(now)
        exact: FloatArray = state[0]
        return exact

    def _legs(self, scan: int) -> Iterator[tuple[int, float]]:
        """Yield the length in scans and the turn rate of every leg up to a scan."""
        reached = self.first_scan
        for turn in self.turns:
            for until, turn_rate in ((turn.first_scan, 0.0), (turn.last_scan, turn.turn_rate)):
                yield min(until, scan) - min(reached, scan), turn_rate
                reached = until
        yield scan - min(reached, scan), 0.0

    def flight(self, interval_s: float) -> Flight:
        """Return the same target with legs in seconds."""
        legs = [
            Leg(scans * interval_s, turn_rate)
            for scans, turn_rate in self._legs(self.last_scan)
            if scans
        ]
        return Flight(
            self.class_id,
            self.snr,
            self.first_scan * interval_s,
            self.position,
            self.velocity,
            tuple(legs) or (Leg(ROUNDING_S),),
            self.height,
        )


@dataclass(frozen=True)
class FlightBlock:
    """A target with legs in a document, without the legs."""

    class_id: int = parameter(0, "Class, from 0.", (0, 1000), required=True)
    position: tuple[float, float] = pair("Position, world frame, m.", required=True)
    velocity: tuple[float, float] = pair("Velocity, world frame, m/s.", required=True)
    snr: float = signal_to_noise(30.0)
    start_s: float = parameter(0.0, "Time of appearance, s after scan 0.", (0.0, 1e7))
    height: float = parameter(0.0, "Height above the world's zero, m.", HEIGHTS)


def targets(document: Mapping[str, Any], faults: list[str]) -> list[TargetScript | Flight]:
    """Return the checked targets; add faults to `faults`."""
    checked = [
        (_flight if "legs" in script else _target)(script, f"targets[{index}].", faults)
        for index, script in enumerate(mappings(document, "targets", "", faults))
    ]
    return [target for target in checked if target is not None]


def _flight(script: Mapping[str, Any], prefix: str, faults: list[str]) -> Flight | None:
    """Return a checked flight; add its faults to `faults` and return None if there are any."""
    block = read(FlightBlock, script, prefix, faults, ("legs",))
    own = legs(script, prefix, faults)
    if block and own:
        with collecting_faults(prefix, faults):
            return Flight(**vars(block), legs=own)
    return None


def legs(script: Mapping[str, Any], prefix: str, faults: list[str]) -> tuple[Leg, ...]:
    """Return the checked legs of a block; add faults to `faults` and then return none."""
    found: list[str] = []
    checked = read_list(Leg, script, "legs", prefix, found)
    if not checked and not found:
        found.append(f"{prefix}legs: none given, must be at least one")
    faults += found
    return () if found else checked


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    turns: list[str] = []
    own = read_list(Turn, script, "turns", prefix, turns)
    target = read(TargetScript, script, prefix, faults, ("turns",), turns=own)
    faults += turns
    return None if turns else target
