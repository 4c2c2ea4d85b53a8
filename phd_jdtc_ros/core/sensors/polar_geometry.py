"""Geometry of measurements in range and azimuth: pure functions of arrays.

Positions are in the world frame, metres; measurements are (range, azimuth) in metres and radians.
`origin` is the radar's position, and `yaw` the direction of its x axis, radians counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray

# Smallest range in divisions, metres: the azimuth is undefined at the radar's own position.
MIN_RANGE = 1.0


def measure(position: FloatArray, origin: Sequence[float], yaw: float) -> FloatArray:
    """Return the measurements of positions, shape (N, 2)."""
    east, north = position[:, 0] - origin[0], position[:, 1] - origin[1]
    # Differences are rotated into the sensor's frame first, so that the azimuth needs no wrapping.
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    measured = np.empty((len(position), 2))
    measured[:, 0], measured[:, 1] = np.sqrt(ahead**2 + left**2), np.arctan2(left, ahead)
    return measured


def to_plane(measurement: FloatArray, origin: Sequence[float], yaw: float) -> FloatArray:
    """Return the positions of measurements, shape (M, 2)."""
    distance, bearing = measurement[:, 0], measurement[:, 1] + yaw
    position = np.empty((len(measurement), 2))
    position[:, 0] = origin[0] + distance * np.cos(bearing)
    position[:, 1] = origin[1] + distance * np.sin(bearing)
    return position
