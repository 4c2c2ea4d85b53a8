"""Surfaces that reflect a target's replies to a radar; the block ``mirrors`` of a scenario.

A hangar's wall makes a radar detect an aircraft twice in a revolution: at its position, and as a
false plot with its code, address and height in the direction of the wall, farther away by the
detour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import FULL_TURN

from ..checked import degrees, pair


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
