"""The part of the world that a tracker is for, where several trackers part an area.

A tracker takes in the detections of its core region and of a margin around it, and reports what is
there. The margins of neighbours overlap, so that a target that crosses the seam is tracked by both
before it changes over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..sensors.sensor import Sensor
from ..types import Detections, Estimates

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Region:
    """A rectangle in the world frame.

    Parameters
    ----------
    x_min, y_min, x_max, y_max : float
        Of the core region, metres.
    margin : float
        What belongs to the tracker on each side beyond it, metres.
    """

    x_min: float
    y_min: float
    x_max: float
    y_max: float
    margin: float = 0.0

    def depth(self, position: FloatArray) -> FloatArray:
        """Return how far inside the core region positions are, metres; negative outside.

        Parameters
        ----------
        position : array of shape (N, 2)
            World frame, metres.

        Returns
        -------
        array of shape (N,)
            Distance to the nearest side; outside, that to the farthest one that is passed.
        """
        low = position - np.array([self.x_min, self.y_min])
        high = np.array([self.x_max, self.y_max]) - position
        depth: FloatArray = np.minimum(low, high).min(axis=1)
        return depth

    def covers(self, position: FloatArray) -> BoolArray:
        """Return whether positions are in the core region or its margin, shape (N,)."""
        inside: BoolArray = self.depth(position) >= -self.margin
        return inside

    def seen(self, detections: Detections, sensor: Sensor) -> Detections:
        """Return a sensor's detections that are in the core region or its margin."""
        place = sensor.at(detections.pose).to_world(detections.measurement)
        inside = self.covers(place)
        return detections if inside.all() else detections.take(np.flatnonzero(inside))

    def reported(self, estimates: Estimates) -> Estimates:
        """Return the estimates that are in the core region or its margin."""
        inside = self.covers(estimates.position)
        return estimates if inside.all() else estimates.take(np.flatnonzero(inside))


@dataclass(frozen=True)
class Everywhere:
    """No part of the world: everything is taken in and reported."""

    def seen(self, detections: Detections, sensor: Sensor) -> Detections:
        """Return all detections."""
        return detections

    def reported(self, estimates: Estimates) -> Estimates:
        """Return all estimates."""
        return estimates


def within(region: Region | Everywhere, found: Sequence[Estimates]) -> tuple[Estimates, ...]:
    """Return what is reported of some estimates."""
    return tuple(region.reported(estimates) for estimates in found)
