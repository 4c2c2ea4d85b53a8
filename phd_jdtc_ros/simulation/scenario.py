"""Scenarios: scripted targets and the radars that observe them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, RadarBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn
from phd_jdtc_ros.core.types import UNKNOWN, Detections, Pose, Truth

from .antenna import Antenna, usual_antenna
from .clutter.echoes import Echoes
from .clutter.law import NOISE, ClutterLaw
from .clutter.mirrors import Mirror
from .clutter.reflectors import Reflectors
from .platform import MovingPlatform
from .traffic.flight import ROUNDING_S, Flight, Leg
from .traffic.gaps import Gap, in_gap
from .transponder import STREAM, Card, Transponders

BoolArray = npt.NDArray[np.bool_]
# True targets follow this model's mean; turn rate 0 is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)


@dataclass(frozen=True)
class Turn:
    """A part of a target's life in which its velocity rotates at a constant rate.

    Parameters
    ----------
    first_scan, last_scan : int
        The turn lasts from the stamp of the first scan to the stamp of the last, at which the
        target flies straight again.
    turn_rate : float
        Radians per second, counter-clockwise.
    """

    first_scan: int
    last_scan: int
    turn_rate: float


@dataclass(frozen=True)
class TargetScript:
    """One target that moves at constant velocity except in its turns.

    Parameters
    ----------
    snr : float
        Mean signal-to-noise ratio, linear.
    position : tuple of two floats
        Position at the first scan, world frame, metres.
    velocity : tuple of two floats
        Velocity at the first scan, metres per second.
    first_scan, last_scan : int
        First and last scan in which the target exists.
    turns : tuple of Turn
        Successive turns, none before the first scan.
    height : float
        Height above the world's zero, metres.
    """

    class_id: int
    snr: float
    position: tuple[float, float]
    velocity: tuple[float, float]
    first_scan: int
    last_scan: int
    turns: tuple[Turn, ...] = ()
    height: float = 0.0

    def __post_init__(self) -> None:
        edges = [self.first_scan, *(e for t in self.turns for e in (t.first_scan, t.last_scan))]
        if edges != sorted(edges):
            raise ValueError(f"turns: {self.turns}, expected one after the other")

    def exists_at(self, scan: int, interval_s: float) -> bool:
        """Return whether the target exists at a scan."""
        return self.first_scan <= scan <= self.last_scan

    def state_at(self, scan: int, interval_s: float) -> FloatArray:
        """Return the exact state at a scan, with the present turn's rate; shape (D,).

        Parameters
        ----------
        scan : int
            At least `first_scan`.
        interval_s : float
            Time between scans, seconds.
        """
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


Target: TypeAlias = "TargetScript | Flight"


@dataclass(frozen=True)
class Scenario:
    """A scenario to simulate.

    Parameters
    ----------
    start_ns : int
        Stamp of scan 0; not zero, which marks an unset time.
    scans : int
        Number of scans, each with the truth. Staring radars report every scan; turning radars
        report at their own times until the last scan.
    antennas : tuple of Antenna
        One per radar.
    most_radars : int
        Number of the nearest turning radars that may detect a target at a time; 0 for all.
    clutter : tuple of ClutterLaw
        One per radar; noise if empty.
    echoes : tuple of (Echoes or None)
        One per radar; empty if targets have a single detection.
    reflectors : tuple of Reflectors
        Fixed clutter of all radars.
    platform : MovingPlatform or None
        A ship with radars, whose positions and directions are in its frame.
    transponders : Transponders or None
        Targets' transponders; None for none.
    biases : tuple of RadarBias
        The biases of each radar; empty for none. Only for turning radars.
    gaps : tuple of Gap
        Times in which targets are out of sight of turning radars.
    mirrors : tuple of Mirror
        Surfaces that reflect targets' replies to turning radars.
    """

    start_ns: int
    interval_s: float
    scans: int
    targets: tuple[Target, ...]
    radars: tuple[RadarModel, ...]
    antennas: tuple[Antenna, ...] = ()
    most_radars: int = 0
    clutter: tuple[ClutterLaw, ...] = ()
    echoes: tuple[Echoes | None, ...] = ()
    reflectors: tuple[Reflectors, ...] = ()
    platform: MovingPlatform | None = None
    transponders: Transponders | None = None
    biases: tuple[RadarBias, ...] = ()
    gaps: tuple[Gap, ...] = ()
    mirrors: tuple[Mirror, ...] = ()

    def __post_init__(self) -> None:
        if self.biases and not self.turning:
            raise ConfigError(["biases: given, must be none where no radar turns"])
        learning = [radar.name for radar in self.radars if radar.clutter_count is not None]
        if learning:
            raise ConfigError(
                [
                    f"{name}.clutter_rate: auto given, must be a number to simulate"
                    for name in learning
                ]
            )
        if not self.antennas:
            usual = tuple(usual_antenna(index) for index in range(len(self.radars)))
            object.__setattr__(self, "antennas", usual)

    def law(self, radar: int) -> ClutterLaw:
        """Return the law of a radar's clutter, by the radar's index."""
        return self.clutter[radar] if self.clutter else NOISE

    def laws(self, radar: int) -> tuple[ClutterLaw, Echoes | None]:
        """Return the law of a radar's clutter and its echoes, by the radar's index."""
        return self.law(radar), self.echoes[radar] if self.echoes else None

    def bias(self, radar: int) -> RadarBias:
        """Return the biases of a radar, by the radar's index."""
        return self.biases[radar] if self.biases else NO_BIAS

    def carrier(self, radar: int) -> MovingPlatform | None:
        """Return the platform of a radar, by the radar's index; None if it is stationary."""
        carries = self.platform is not None and radar in self.platform.radars
        return self.platform if carries else None

    def measure(self, radar: int, state: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return noise-free (range, azimuth) of states from a radar's pose at their times.

        Parameters
        ----------
        state : array of shape (N, D)
        time_s : array of shape (N,)
            Seconds after scan 0.

        Returns
        -------
        array of shape (N, 2)
        """
        carrier = self.carrier(radar)
        seen = state if carrier is None else carrier.to_platform(state, time_s)
        return self.radars[radar].measure(seen)

    def poses(self) -> list[tuple[int, Pose]]:
        """Return the stamps and poses of the platform, ascending, until the end of the run.

        Empty without a platform.
        """
        if self.platform is None:
            return []
        known = self.platform.poses_until(self.duration_s)
        return [(self.ns_after(elapsed_s), pose) for elapsed_s, pose in known]

    def radar_at(self, radar: int, elapsed_s: float) -> RadarModel:
        """Return a radar with its position in the world at a time after scan 0, seconds."""
        model, carrier = self.radars[radar], self.carrier(radar)
        return model if carrier is None else model.at(carrier.radar_pose(model, elapsed_s))

    @property
    def turning(self) -> bool:
        """Whether any radar's antenna turns, so that there is no common scan."""
        return any(radar.rotation_s > 0.0 for radar in self.radars)

    @property
    def duration_s(self) -> float:
        """Time from scan 0 to the last scan, seconds."""
        return (self.scans - 1) * self.interval_s

    @cached_property
    def flights(self) -> tuple[Flight, ...]:
        """Every target, with legs in seconds."""
        return tuple(
            target if isinstance(target, Flight) else target.flight(self.interval_s)
            for target in self.targets
        )

    def height(self, number: int, time_s: FloatArray) -> FloatArray:
        """Return a target's heights above the world's zero, metres, shape (N,).

        Parameters
        ----------
        number : int
            Number of the target, from 1.
        time_s : array of shape (N,)
            Seconds after scan 0.
        """
        if self.transponders is not None:
            return self.cards[number].height(time_s)[:, 0]
        return np.full(len(time_s), self.flights[number - 1].height)

    @cached_property
    def cards(self) -> dict[int, Card]:
        """The transponder settings of each target, by number from 1; empty without transponders."""
        if self.transponders is None:
            return {}
        return {
            number: self.transponders.card(number, flight, self.duration_s)
            for number, flight in enumerate(self.flights, start=1)
        }

    def hidden(self, number: int, time_s: FloatArray) -> BoolArray:
        """Return whether a target, by number from 1, is in a gap at times after scan 0, (N,)."""
        return in_gap(self.gaps, number, time_s)

    def answers(self, number: int) -> bool:
        """Return whether a target, by number from 1, has a transponder."""
        return number in self.cards and self.cards[number].code != UNKNOWN

    def with_replies(
        self, found: Detections, source: IntArray, time_s: FloatArray, seed: Sequence[int]
    ) -> Detections:
        """Return detections with their targets' replies; see `Transponders.with_replies`."""
        if self.transponders is None:
            return found
        rng = np.random.default_rng([*seed, STREAM])
        return self.transponders.with_replies(found, source, time_s, self.cards, rng)

    def until(self, elapsed_s: float) -> Scenario:
        """Return the scenario cut at a time after scan 0, seconds."""
        there = [row for row, flight in enumerate(self.flights) if flight.start_s <= elapsed_s]
        number = {row + 1: own for own, row in enumerate(there, start=1)}
        return replace(
            self,
            scans=min(self.scans, int(elapsed_s / self.interval_s) + 1),
            targets=tuple(self.targets[row] for row in there),
            gaps=tuple(
                gap._replace(number=number[gap.number]) for gap in self.gaps if gap.number in number
            ),
        )

    def stamp_ns(self, scan: int) -> int:
        """Return the stamp of a scan in nanoseconds."""
        return self.ns_after(scan * self.interval_s)

    def ns_after(self, elapsed_s: float) -> int:
        """Return the stamp of a time after scan 0, in nanoseconds."""
        return self.start_ns + round(elapsed_s * 1e9)


def truth_at(scenario: Scenario, scan: int) -> Truth:
    """Return the scenario's targets at a scan."""
    stamp_ns, interval_s = scenario.stamp_ns(scan), scenario.interval_s
    found = _truth(scenario.targets, scan, interval_s, stamp_ns)
    return _with_heights(found, scenario, scan * interval_s)


def truth_after(scenario: Scenario, elapsed_s: float) -> Truth:
    """Return the scenario's targets at any time after scan 0, seconds."""
    found = _truth(scenario.flights, 1, elapsed_s, scenario.ns_after(elapsed_s))
    return _with_heights(found, scenario, elapsed_s)


def _truth(targets: Sequence[Target], scan: int, interval_s: float, stamp_ns: int) -> Truth:
    alive = [
        (number, target)
        for number, target in enumerate(targets, start=1)
        if target.exists_at(scan, interval_s)
    ]
    state = np.zeros((len(alive), len(NOISE_FREE.space)))
    for row, (_, target) in enumerate(alive):
        state[row] = target.state_at(scan, interval_s)
    return Truth(
        stamp_ns=stamp_ns,
        state=state,
        track_id=np.array([number for number, _ in alive], dtype=np.int64),
        class_id=np.array([target.class_id for _, target in alive], dtype=np.int64),
    )


def _with_heights(found: Truth, scenario: Scenario, elapsed_s: float) -> Truth:
    if scenario.transponders is None:
        return found
    now = np.array([elapsed_s])
    each = [scenario.cards[number].height(now)[0] for number in found.track_id.tolist()]
    return replace(found, height=np.reshape(each, (-1, 2)))


def paper_scenario(radars: tuple[RadarModel, ...]) -> Scenario:
    """Return the reference scenario: four targets of two classes, two crossings.

    Parameters
    ----------
    radars : tuple of RadarModel
        The scenario's own are the defaults of the configuration.

    Notes
    -----
    Sec. V, which does not give the speeds. With the speeds chosen here, target 1 crosses target 2
    (of the other class) and then target 3 (of its own class), and target 4 crosses target 2 (of its
    own class), near the radars.
    """
    strong, weak = snr_from_db(45.0), snr_from_db(25.0)
    return Scenario(
        start_ns=1_000_000_000_000,
        interval_s=6.0,
        scans=80,
        targets=(
            TargetScript(0, strong, (-10e3, 10e3), (36.0, -44.0), 0, 59),
            TargetScript(1, weak, (-10e3, -10e3), (36.0, 44.0), 0, 59),
            TargetScript(0, strong, (-10e3, -10.5e3), (36.0, 44.0), 0, 59),
            TargetScript(1, weak, (1.4e3, 8e3), (0.0, -20.7), 20, 79),
        ),
        radars=radars,
    )
