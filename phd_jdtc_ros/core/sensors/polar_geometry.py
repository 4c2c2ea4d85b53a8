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


def linearise(
    position: FloatArray, origin: Sequence[float] | FloatArray, yaw: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the measurements of positions, (..., 2), and their derivatives by the position.

    Every position may have its own radar: `origin` is then (..., 2), and `yaw` (...).
    """
    line = position - np.asarray(origin)
    east, north = line[..., 0], line[..., 1]
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    distance = np.maximum(np.sqrt(ahead**2 + left**2), MIN_RANGE)
    along, across = east / distance, north / distance
    measured, jacobian = np.empty(position.shape), np.empty((*position.shape, 2))
    measured[..., 0], measured[..., 1] = distance, np.arctan2(left, ahead)
    jacobian[..., 0, 0], jacobian[..., 0, 1] = along, across
    jacobian[..., 1, 0], jacobian[..., 1, 1] = -across / distance, along / distance
    return measured, jacobian


def line_of_sight(
    position: FloatArray, origin: Sequence[float] | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors to positions, (N, P), and the distances, (N,)."""
    line = position - np.asarray(origin)
    distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
    return line / distance[:, None], distance


def to_plane(measurement: FloatArray, origin: Sequence[float], yaw: float) -> FloatArray:
    """Return the positions of measurements, shape (M, 2)."""
    distance, bearing = measurement[:, 0], measurement[:, 1] + yaw
    position = np.empty((len(measurement), 2))
    position[:, 0] = origin[0] + distance * np.cos(bearing)
    position[:, 1] = origin[1] + distance * np.sin(bearing)
    return position
