"""Scenarios: targets and the radars that observe them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from phd_jdtc_ros.configuration.schema import ConfigError, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.intake.poses import Mount
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.types import LEVEL, UNKNOWN, Detections, Pose, Truth

from .antenna import Antenna, default_antenna
from .checked import collecting_faults, degrees, mapping, pair, read
from .clutter import NOISE, ClutterLaw, Echoes, Mirror, Reflectors
from .targets import HEIGHTS, NOISE_FREE, Flight, Gap, TargetScript, in_gap, legs
from .transponder import STREAM, ReplyContent, Transponders

_POSITION, SWINGS = list(PLANAR.position), (0.0, 60.0)


@dataclass(frozen=True)
class PlatformBlock:
    """The block ``platform`` without its legs."""

    radars: list[str] = parameter(
        [], "Names of the radars on the platform.", element=str, required=True
    )
    position: tuple[float, float] = pair("Position at scan 0, world frame, m.", required=True)
    velocity: tuple[float, float] = pair("Velocity at scan 0, world frame, m/s.", required=True)
    pose_interval_s: float = parameter(0.5, "Interval between poses, s.", (1e-3, 60.0))
    height: float = parameter(0.0, "Height at scan 0, world frame, m; in space.", HEIGHTS)
    pitch: float = degrees(
        0.0, "Largest pitch of its swing, degrees; in space.", SWINGS, "pitch_deg"
    )
    roll: float = degrees(0.0, "Largest roll of its swing, degrees; in space.", SWINGS, "roll_deg")
    swing_s: float = parameter(8.0, "Period of the swing, s.", (0.1, 1e4))

    def __post_init__(self) -> None:
        if not self.radars:
            raise ConfigError("radars: none given, must be at least one")


@dataclass(frozen=True)
class MovingPlatform:
    """A ship with radars. It heads along its course, and its radars turn and swing with it."""

    motion: Flight  # Motion from scan 0 on; after the last leg it continues as in that leg
    # Indices of the carried radars. Their positions and directions are in the platform's frame: x
    # ahead, y to the left.
    radars: tuple[int, ...]
    pose_interval_s: float = 0.5  # Interval of the published poses, seconds
    swing: tuple[float, float] = LEVEL  # Largest pitch and roll, radians, a quarter period apart
    swing_s: float = 8.0  # Period of the swing, seconds

    def poses(self, time_s: FloatArray) -> FloatArray:
        """Return x, y (m) and yaw (rad) in the world at times after scan 0; (N,) to (N, 3)."""
        position = self.motion.states(time_s)[:, _POSITION]
        return np.column_stack([position, self.motion.courses(time_s)])

    def pose(self, time_s: float) -> Pose:
        """Return the pose at a time after scan 0."""
        now = np.array([time_s])
        x, y, yaw = self.poses(now)[0].tolist()
        height, phase = float(self.motion.heights(now)[0, 0]), 2.0 * math.pi * time_s / self.swing_s
        tilt = self.swing[0] * math.sin(phase), self.swing[1] * math.cos(phase)
        # Without a swing the sign of a zero would depend on the time.
        tilt = LEVEL if self.swing == LEVEL else tilt
        return Pose((x, y), math.remainder(yaw, 2.0 * math.pi), height=height, tilt=tilt)

    def radar_pose(self, radar: RadarModel, time_s: float) -> Pose:
        """Return the pose of a carried radar in the world."""
        own = radar.pose
        return Mount(own.position, own.yaw, own.height, own.tilt).on(self.pose(time_s))

    def to_platform(self, state: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return states with positions in the platform's frame at these times, shape (N, D)."""
        x, y, yaw = self.poses(time_s).T
        east, north = state[:, _POSITION[0]] - x, state[:, _POSITION[1]] - y
        relative = np.zeros_like(state)
        relative[:, _POSITION[0]] = np.cos(yaw) * east + np.sin(yaw) * north
        relative[:, _POSITION[1]] = np.cos(yaw) * north - np.sin(yaw) * east
        return relative


def platform(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> MovingPlatform | None:
    """Return the platform in a scenario document, None without one; add faults to `faults`."""
    given = mapping(document, "platform", faults)
    if not given:
        return None
    block = read(PlatformBlock, given, "platform.", faults, ("legs",))
    flight_legs = legs(given, "platform.", faults)
    if block is None or not flight_legs:
        return None
    known = [radar.name for radar in radars]
    found = [
        f"platform.radars: {name!r} given, must be some of {', '.join(known)}"
        for name in block.radars
        if name not in known
    ]
    found += [
        f"platform.radars: {radar.name!r} has range rates, which can be simulated only for "
        "stationary radars"
        for radar in radars
        if radar.range_rate is not None and radar.name in block.radars
    ]
    faults += found
    if not found:
        with collecting_faults("platform.", faults):
            motion = Flight(0, 0.0, 0.0, block.position, block.velocity, flight_legs, block.height)
            carried = tuple(map(known.index, block.radars))
            swing = block.pitch, block.roll
            return MovingPlatform(motion, carried, block.pose_interval_s, swing, block.swing_s)
    return None


Target: TypeAlias = "TargetScript | Flight"


@dataclass(frozen=True)
class Scenario:
    """A scenario to simulate."""

    start_ns: int  # Stamp of scan 0; not zero, which marks an unset time
    interval_s: float
    # Number of scans, each with the truth. Staring radars report every scan; turning radars report
    # at their own times until the last scan.
    scans: int
    targets: tuple[Target, ...]
    radars: tuple[RadarModel, ...]
    antennas: tuple[Antenna, ...] = ()  # One per radar
    # Number of the nearest turning radars that may detect a target at a time; 0 for all.
    most_radars: int = 0
    clutter: tuple[ClutterLaw, ...] = ()  # One per radar; noise if empty
    # One per radar; empty if targets have a single detection.
    echoes: tuple[Echoes | None, ...] = ()
    reflectors: tuple[Reflectors, ...] = ()  # Fixed clutter of all radars
    # A ship with radars, whose positions and directions are in its frame.
    platform: MovingPlatform | None = None
    transponders: Transponders | None = None  # Targets' transponders; None for none
    # The biases of each radar; empty for none. Only for turning radars.
    biases: tuple[SensorBias, ...] = ()
    gaps: tuple[Gap, ...] = ()  # Times in which targets are out of sight of turning radars
    mirrors: tuple[Mirror, ...] = ()  # Surfaces that reflect targets' replies to turning radars

    def __post_init__(self) -> None:
        if self.biases and not self.turning:
            raise ConfigError("biases: given, must be none where no radar turns")
        if self.turning and self.platform and any(radar.space.vertical for radar in self.radars):
            raise ConfigError("state: space given, must be plane where a radar on a platform turns")
        if not self.antennas:
            usual = tuple(default_antenna(index) for index in range(len(self.radars)))
            object.__setattr__(self, "antennas", usual)

    def law(self, radar: int) -> ClutterLaw:
        """Return the clutter law of the radar with this index."""
        return self.clutter[radar] if self.clutter else NOISE

    def bias(self, radar: int) -> SensorBias:
        """Return the biases of a radar, by the radar's index."""
        return self.biases[radar] if self.biases else NO_BIAS

    def carrier(self, radar: int) -> MovingPlatform | None:
        """Return the platform of a radar, by the radar's index; None if it is stationary."""
        carries = self.platform is not None and radar in self.platform.radars
        return self.platform if carries else None

    def measure(self, radar: int, state: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return noise-free measurements of states (N, D) from a radar's pose, shape (N, Z).

        `time_s`, shape (N,), has their times after scan 0, seconds.
        """
        carrier = self.carrier(radar)
        seen = state if carrier is None else carrier.to_platform(state, time_s)
        return self.radars[radar].measure(seen)

    def poses(self) -> list[tuple[int, Pose]]:
        """Return the stamps and poses of the platform, ascending; the last is not before the end.

        Empty without a platform.
        """
        if self.platform is None:
            return []
        interval_s = self.platform.pose_interval_s
        count = math.ceil(self.duration_s / interval_s - 1e-9) + 1
        times = (index * interval_s for index in range(count))
        return [(self.ns_after(time_s), self.platform.pose(time_s)) for time_s in times]

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

    def heights(self, number: int, time_s: FloatArray) -> FloatArray:
        """Return the heights and climb rates of a target, by number from 1, (N, 2).

        `time_s`, (N,), is after scan 0; metres and metres per second.
        """
        if self.transponders is not None:
            return self.replies_of[number].height(time_s)
        return self.flights[number - 1].heights(time_s)

    @cached_property
    def replies_of(self) -> dict[int, ReplyContent]:
        """The content of each target's replies, by number from 1; empty without transponders."""
        if self.transponders is None:
            return {}
        return {
            number: self.transponders.reply_content(number, flight, self.duration_s)
            for number, flight in enumerate(self.flights, start=1)
        }

    def is_hidden(self, number: int, time_s: FloatArray) -> BoolArray:
        """Return whether a target, by number from 1, is in a gap at times after scan 0, (N,)."""
        return in_gap(self.gaps, number, time_s)

    def has_transponder(self, number: int) -> bool:
        """Return whether a target, by number from 1, has a transponder."""
        return number in self.replies_of and self.replies_of[number].code != UNKNOWN

    def with_replies(
        self, found: Detections, source: IntArray, time_s: FloatArray, seed: Sequence[int]
    ) -> Detections:
        """Return detections with their targets' replies; see `Transponders.with_replies`."""
        if self.transponders is None:
            return found
        rng = np.random.default_rng([*seed, STREAM])
        return self.transponders.with_replies(found, source, time_s, self.replies_of, rng)

    def stamp_ns(self, scan: int) -> int:
        """Return the stamp of a scan in nanoseconds."""
        return self.ns_after(scan * self.interval_s)

    def ns_after(self, elapsed_s: float) -> int:
        """Return the stamp of a time after scan 0, in nanoseconds."""
        return self.start_ns + round(elapsed_s * 1e9)


def truth_at(scenario: Scenario, scan: int) -> Truth:
    """Return the scenario's targets at a scan."""
    interval_s = scenario.interval_s
    elapsed_s = scan * interval_s
    states = (
        target.state_at(elapsed_s)
        if isinstance(target, Flight)
        else target.state_at(scan, interval_s)
        for target in scenario.targets
    )
    return _truth(scenario, elapsed_s, states)


def truth_after(scenario: Scenario, elapsed_s: float) -> Truth:
    """Return the scenario's targets at any time after scan 0, seconds."""
    states = (flight.state_at(elapsed_s) for flight in scenario.flights)
    return _truth(scenario, elapsed_s, states)


def _truth(scenario: Scenario, elapsed_s: float, states: Iterable[FloatArray | None]) -> Truth:
    """Return the targets at a time, given the state of each; None for those that do not exist."""
    alive = [(row, state) for row, state in enumerate(states) if state is not None]
    height = None
    if scenario.transponders is not None or any(r.space.vertical for r in scenario.radars):
        now = np.array([elapsed_s])
        height = np.reshape([scenario.heights(row + 1, now)[0] for row, _ in alive], (-1, 2))
    return Truth(
        stamp_ns=scenario.ns_after(elapsed_s),
        state=np.reshape([state for _, state in alive], (-1, len(NOISE_FREE.space))),
        track_id=np.array([row + 1 for row, _ in alive], dtype=np.int64),
        class_id=np.array([scenario.targets[row].class_id for row, _ in alive], dtype=np.int64),
        height=height,
    )


def paper_scenario(radars: tuple[RadarModel, ...]) -> Scenario:
    """Return the reference scenario: four targets of two classes, two crossings.

    Its own radars are the defaults of the configuration. It is that of Sec. V, which does not give
    the speeds. With the speeds chosen here, target 1 crosses target 2 (of the other class) and then
    target 3 (of its own class), and target 4 crosses target 2 (of its own class), near the radars.
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
