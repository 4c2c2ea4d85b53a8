"""Several detections of a target in a scan; the block ``echoes`` of a scenario document.

A radar of high resolution detects bumpers, wheels and corners of a vehicle separately.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import StateSpace
from phd_jdtc_ros.core.types import FULL_TURN

from ..checked import degrees, pair, read_by_radar


@dataclass(frozen=True)
class Echoes:
    """Further detections of targets by one radar in a scan."""

    probability: float = parameter(
        0.3, "Probability that a detected target has further detections.", (0.0, 1.0)
    )
    most: int = parameter(2, "Their largest number; all up to it are equally probable.", (1, 100))
    length_std: float = parameter(
        1.2, "Their standard deviation along the course, m.", (SMALL, 1e3)
    )
    width_std: float = parameter(
        0.5, "Their standard deviation across the course, m.", (SMALL, 1e3)
    )

    def sources(
        self, state: FloatArray, space: StateSpace, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the states of the echoes' sources, (E, D), and the row of each one's target, (E,).

        `state`, shape (N, D), has the states of the detected targets.
        """
        more = rng.random(len(state)) < self.probability
        count = np.where(more, rng.integers(1, self.most + 1, len(state)), 0)
        row = np.arange(len(state)).repeat(count)
        spread = rng.standard_normal((len(row), 2)) * [self.length_std, self.width_std]
        echo = state[row]
        velocity = echo[:, list(space.velocity)]
        course = np.arctan2(velocity[:, 1], velocity[:, 0])
        cos, sin = np.cos(course), np.sin(course)
        x, y = space.position
        echo[:, x] += cos * spread[:, 0] - sin * spread[:, 1]
        echo[:, y] += sin * spread[:, 0] + cos * spread[:, 1]
        return echo, row


def of_radars(
    document: Mapping[str, object], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Echoes | None, ...]:
    """Return every radar's echoes, None for a radar without; empty if no radar has any."""
    echoes = tuple(read_by_radar(Echoes, document, "echoes", radars, faults))
    faults += [
        f"echoes.{radar.name}: given, must be absent for a turning radar"
        for radar, own in zip(radars, echoes, strict=True)
        if own is not None and radar.rotation_s
    ]
    return echoes if any(echoes) else ()


@dataclass(frozen=True)
class Mirror:
    """A surface that reflects the replies of targets in some directions."""

    position: tuple[float, float] = pair("Position, world frame, m.", required=True)
    # The directions are seen from the radar.
    start: float = degrees(
        0.0,
        "First azimuth of reflected targets, clockwise from the y axis, degrees.",
        (-360.0, 360.0),
        "start_deg",
        required=True,
    )
    width: float = degrees(
        360.0, "Width of these azimuths, degrees.", (SMALL, 360.0), "width_deg", required=True
    )
    probability: float = parameter(
        0.1, "Probability of a reflection in each revolution.", (0.0, 1.0), required=True
    )

    def reflects(
        self, position: FloatArray, radar: RadarModel, rng: np.random.Generator
    ) -> BoolArray:
        """Return which replies from positions in the world, shape (N, 2), are reflected."""
        east, north = (position - radar.position).T
        turned = np.mod(np.arctan2(east, north) - self.start, FULL_TURN)
        drawn = rng.random(len(position)) < self.probability
        found: BoolArray = drawn & (turned < self.width)
        return found

    def detour(self, position: FloatArray, radar: RadarModel) -> FloatArray:
        """Return the increase of the ranges by the reflection, metres, shape (N,)."""
        own = math.dist(self.position, radar.position)
        longer: FloatArray = (
            own + np.hypot(*(position - self.position).T) - np.hypot(*(position - radar.position).T)
        )
        return longer
