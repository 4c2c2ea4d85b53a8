"""A ship or vehicle that carries radars of a scenario; the document's block ``platform``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.schema import ConfigError, parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.poses import Mount
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import LEVEL, Pose

from .checked import collecting_faults, degrees, mapping, pair, read
from .traffic.flight import Flight
from .traffic.targets import HEIGHTS, legs

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
