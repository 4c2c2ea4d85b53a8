"""Conflicts: what counts as one, and what is said of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly
from ..models.zones import Zone
from ..types import Attributes

# What a conflict is with: own ship and a track, two tracks, or a track or own ship and a zone.
OWN, PAIR, ZONE = range(3)
KINDS = ("own ship", "tracks", "zone")
# The number of own ship in the place of a track number.
OWN_SHIP = 0


@dataclass(frozen=True)
class LevelFlight:
    """How aircraft keep and change their levels, for heights beside the states.

    An aircraft keeps its level for minutes, and then changes it at a nearly constant rate. So a
    path is level, or climbs or descends, for times that are exponentially distributed.
    """

    slowest: float = 1.5  # Climb rate below which an aircraft is level, 300 ft/min, m/s
    level_s: float = 600.0  # Mean time until a level aircraft begins to climb or to descend
    climb_s: float = 180.0  # Mean time until it is level again, seconds
    climb_std: float = 8.0  # Standard deviation of the rate of a new climb or descent, m/s

    def paths(
        self,
        known: Attributes,
        age_s: float,
        interval_s: float,
        size: tuple[int, int],
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return heights at the K + 1 points of N paths of each target, (T, N, K + 1), metres.

        `size` is N and K + 1. They begin `age_s` after the heights that are known, and are NaN
        where none is.
        """
        count, points = size
        unknown = np.isnan(known.height[:, 0])
        mean = np.where(unknown[:, None], 0.0, known.height)
        covariance = np.where(unknown[:, None, None], 0.0, known.height_covariance)
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        drawn = mean[:, None] + rng.standard_normal((len(mean), count, 2)) @ root.swapaxes(1, 2)
        height, climb = drawn[..., 0], drawn[..., 1]
        level = np.abs(mean[:, 1]) < self.slowest + np.sqrt(covariance[:, 1, 1])
        climb[level] = 0.0
        height = height + age_s * climb
        found = np.empty((len(mean), count, points))
        for point in range(points):
            found[:, :, point] = height
            height = height + interval_s * climb
            lasting_s = np.where(climb == 0.0, self.level_s, self.climb_s)
            ends = rng.random(climb.shape) < -np.expm1(-interval_s / lasting_s)
            fresh = self.climb_std * rng.standard_normal(climb.shape)
            climb = np.where(ends, np.where(climb == 0.0, fresh, 0.0), climb)
        found[unknown] = np.nan
        return found


@dataclass(frozen=True)
class ConflictModel:
    """What counts as a danger, and how it is computed."""

    distance: float = 0.0  # Least distance that is none, metres; 0 for zones only
    # Least difference of heights that is none, metres; 0 if heights do not matter.
    height: float = 0.0
    level_flight: LevelFlight = field(default_factory=LevelFlight)
    horizon_s: float = 360.0  # How far ahead dangers are predicted, seconds
    alarms_per_hour: float = 6.0  # How many alarms may be raised in an hour, see `Alarms`
    zones: tuple[Zone, ...] = ()
    # A probability has a standard deviation of at most 0.03 by the number of paths. The intervals
    # are 15 s of 6 minutes: in a turn of 3 degrees a second a path is then within 3 % of a chord.
    paths: int = 256
    steps: int = 24
    # Time between two computations by the stamps of scans, seconds; one takes 1 ms for a track.
    period_s: float = 2.0
    least_probability: float = 0.01  # A less probable conflict is not reported
    # Motions for tracking allow for more manoeuvres than there are in minutes, so that shares of
    # paths are too near one half. The log odds of a probability are those of the share times
    # `slope` plus `offset`, fitted to seeds 0 to 7 of the study of conflicts, both scenes alike.
    slope: float = 1.3
    offset: float = 0.2

    @property
    def enabled(self) -> bool:
        """Whether there is anything to watch."""
        return self.distance > 0.0 or bool(self.zones)

    def calibrated(self, share: float) -> float:
        """Return the probability of what happens on a share of the paths."""
        if not 0.0 < share < 1.0:
            return share
        log_odds = self.slope * math.log(share / (1.0 - share)) + self.offset
        return 1.0 / (1.0 + math.exp(-log_odds))

    @property
    def interval_s(self) -> float:
        """Time between two points of a path, seconds."""
        return self.horizon_s / self.steps


@dataclass(frozen=True)
class Conflicts(ReadOnly):
    """The conflicts at one stamp, by descending probability.

    In a conflict of two objects the first is own ship, with the number 0, or the track with the
    smaller number. In one with a zone it is the track, or own ship, and the second is the index of
    the zone.
    """

    stamp_ns: int
    kind: IntArray  # `OWN`, `PAIR` or `ZONE`, (K,)
    first: IntArray  # (K,)
    second: IntArray  # (K,)
    # Probability that the distance falls below the least one, or that the zone is entered, within
    # the horizon, (K,).
    probability: FloatArray
    time_s: FloatArray  # Median time until then, if it happens, seconds, (K,)
    # Of both at present courses and speeds; NaN for a zone.
    cpa: FloatArray  # Distance of the closest point of approach, metres, (K,)
    tcpa_s: FloatArray  # Time until then, seconds, negative after it, (K,)
    # Place of the second from the first at that time: ahead of it, or astern if negative, and to
    # its starboard, or port if negative, metres, (K,).
    ahead: FloatArray
    starboard: FloatArray
    # Mean place of the track, or of the second object, at the median time, metres, (K, 2).
    place: FloatArray
    alarm: IntArray  # 0 for no alarm, 1 for an alarm, 2 for an acknowledged one, (K,)

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def keys(self) -> list[tuple[int, int, int]]:
        """What identifies each conflict as long as it lasts: its kind and both numbers."""
        columns = (self.kind.tolist(), self.first.tolist(), self.second.tolist())
        return list(zip(*columns, strict=True))


class Approach(NamedTuple):
    """The closest point of approach of a second object to a first one, at constant velocities."""

    distance: float  # Metres
    time_s: float  # Seconds, negative after it; NaN without relative motion, and all else with it
    # Place of the second from the first one then, by the first one's course, metres; by its
    # direction to the second one now if it is at rest.
    ahead: float
    starboard: float


def closest_approach(line: FloatArray, velocity: FloatArray, course: FloatArray) -> Approach:
    """Return the closest approach.

    `line` and `velocity` are the second object's position and velocity relative to the first one,
    and `course` is the first one's velocity, (2,) each.
    """
    square = float(velocity @ velocity)
    if not square > 0.0:
        return Approach(float(np.hypot(*line)), math.nan, math.nan, math.nan)
    time_s = -float(line @ velocity) / square
    at = line + time_s * velocity
    heading = course if course.any() else line
    x, y = heading / max(float(np.hypot(*heading)), np.finfo(float).tiny)
    ahead, starboard = float(at @ (x, y)), float(at @ (y, -x))
    return Approach(float(np.hypot(*at)), time_s, ahead, starboard)


def words(conflicts: Conflicts, row: int, zones: Sequence[Zone]) -> str:
    """Return a conflict in words, such as ``own ship and track 12: 70% in 3.0 min, ...``.

    A zone that is not among `zones` has no name.
    """
    kind, first, second = conflicts.keys[row]
    name = "own ship" if first == OWN_SHIP else f"track {first}"
    chance = f"{conflicts.probability[row]:.0%} in {conflicts.time_s[row] / 60.0:.1f} min"
    if kind == ZONE:
        known = zones[second : second + 1]
        where = next((f"{zone.kind} zone {zone.name}" for zone in known), "a zone")
        return f"{name} in {where}: {chance}"
    approach = f"CPA {conflicts.cpa[row]:.0f} m"
    if not math.isnan(conflicts.tcpa_s[row]):
        way = "ahead" if conflicts.ahead[row] >= 0.0 else "astern"
        side = "starboard" if conflicts.starboard[row] >= 0.0 else "port"
        approach += f" {way} to {side} in {conflicts.tcpa_s[row] / 60.0:.1f} min"
    return f"{name} and track {second}: {chance}, {approach}"
