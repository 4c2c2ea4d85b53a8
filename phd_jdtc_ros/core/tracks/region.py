"""The region of a tracker, if several trackers share an area.

A tracker processes the detections in its core region and in a margin around it, and reports the
tracks there. The margins of neighbours overlap, so that both track a target that crosses the
boundary before it is handed over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..sensors.sensor import Sensor
from ..types import Detections, Estimates


@dataclass(frozen=True)
class Region:
    """A rectangle in the world frame."""

    # Bounds of the core region, metres.
    x_min: float
    y_min: float
    x_max: float
    y_max: float
    # Width of the strip around the core region that the tracker also covers, metres.
    margin: float = 0.0

    def depth(self, position: FloatArray) -> FloatArray:
        """Return the depth of positions, (N, 2), inside the core region, metres, (N,).

        It is the distance to the nearest side; outside, the negative distance to the farthest side
        crossed.
        """
        low = position - np.array([self.x_min, self.y_min])
        high = np.array([self.x_max, self.y_max]) - position
        depth: FloatArray = np.minimum(low, high).min(axis=1)
        return depth

    def covers(self, position: FloatArray) -> BoolArray:
        """Return a mask of positions in the core region or its margin, shape (N,)."""
        return self.depth(position) >= -self.margin

    def select_detections(self, detections: Detections, sensor: Sensor) -> Detections:
        """Return a sensor's detections in the core region or its margin."""
        position = sensor.at(detections.pose).to_world(detections.measurement)[:, :2]
        inside = self.covers(position)
        return detections if inside.all() else detections.take(np.flatnonzero(inside))

    def select_estimates(self, estimates: tuple[Estimates, ...]) -> tuple[Estimates, ...]:
        """Return the estimates of each stamp in the core region or its margin."""
        return tuple(targets.select(self.covers(targets.position)) for targets in estimates)
