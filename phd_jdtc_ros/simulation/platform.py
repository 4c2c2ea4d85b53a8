"""A ship that carries radars of a scenario; the document's block ``platform``."""

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
from phd_jdtc_ros.core.types import Pose

from .checked import collecting_faults, mapping, pair, read
from .traffic.flight import Flight
from .traffic.targets import legs

_POSITION = list(PLANAR.position)


@dataclass(frozen=True)
class PlatformBlock:
    """The block ``platform`` without its legs."""

    radars: list[str] = parameter(
        [], "Names of the radars on the platform.", element=str, required=True
    )
    position: tuple[float, float] = pair("Position at scan 0, world frame, m.", required=True)
    velocity: tuple[float, float] = pair("Velocity at scan 0, world frame, m/s.", required=True)
    pose_interval_s: float = parameter(0.5, "Interval between poses, s.", (1e-3, 60.0))

    def __post_init__(self) -> None:
        if not self.radars:
            raise ConfigError("radars: none given, must be at least one")


@dataclass(frozen=True)
class MovingPlatform:
    """A ship with radars. It heads along its course, and its radars turn with it."""

    motion: Flight  # Motion from scan 0 on; after the last leg it continues as in that leg
    # Indices of the carried radars. Their positions and directions are in the platform's frame: x
    # ahead, y to the left.
    radars: tuple[int, ...]
    pose_interval_s: float = 0.5  # Interval of the published poses, seconds

    def poses(self, time_s: FloatArray) -> FloatArray:
        """Return x, y (m) and yaw (rad) in the world at times after scan 0; (N,) to (N, 3)."""
        position = self.motion.states(time_s)[:, _POSITION]
        return np.column_stack([position, self.motion.courses(time_s)])

    def pose(self, time_s: float) -> Pose:
        """Return the pose at a time after scan 0."""
        x, y, yaw = self.poses(np.array([time_s]))[0].tolist()
        return Pose((x, y), math.remainder(yaw, 2.0 * math.pi))

    def radar_pose(self, radar: RadarModel, time_s: float) -> Pose:
        """Return the pose of a carried radar in the world."""
        return Mount(radar.position, radar.yaw).on(self.pose(time_s))

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
            motion = Flight(0, 0.0, 0.0, block.position, block.velocity, flight_legs)
            carried = tuple(map(known.index, block.radars))
            return MovingPlatform(motion, carried, block.pose_interval_s)
    return None
