"""Geometry of measurements in range and azimuth: pure functions of arrays.

Positions and velocities are in the world frame, metres and metres per second; measurements are
(range, azimuth) in metres and radians. `origin` is the radar's position, and `yaw` the direction of
its x axis, radians counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..types import FULL_TURN, Detections

# Smallest range in divisions, metres: the azimuth is undefined at the radar's own position.
MIN_RANGE = 1.0


def measure(position: FloatArray, origin: Sequence[float], yaw: float) -> FloatArray:
    """Return the measurements of positions, shape (N, 2)."""
    east, north = position[:, 0] - origin[0], position[:, 1] - origin[1]
    # Differences are rotated into the sensor's frame first, so that the azimuth needs no wrapping.
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    return np.stack([np.sqrt(ahead**2 + left**2), np.arctan2(left, ahead)], axis=1)


def linearise(
    position: FloatArray, origin: Sequence[float], yaw: float
) -> tuple[FloatArray, FloatArray]:
    """Return the measurements of positions, (..., 2), and their derivatives by the position."""
    line = position - np.asarray(origin)
    east, north = line[..., 0], line[..., 1]
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    distance = np.maximum(np.sqrt(ahead**2 + left**2), MIN_RANGE)
    along, across = east / distance, north / distance
    jacobian = np.empty((*position.shape, 2))
    jacobian[..., 0, 0], jacobian[..., 0, 1] = along, across
    jacobian[..., 1, 0], jacobian[..., 1, 1] = -across / distance, along / distance
    return np.stack([distance, np.arctan2(left, ahead)], axis=-1), jacobian


def rates(position: FloatArray, velocity: FloatArray, origin: Sequence[float]) -> FloatArray:
    """Return the time derivatives of the measurements of moving positions, shape (N, 2)."""
    along, distance = line_of_sight(position, origin)
    radial = (along * velocity).sum(axis=1)
    tangential = along[:, 0] * velocity[:, 1] - along[:, 1] * velocity[:, 0]
    return np.stack([radial, tangential / distance], axis=1)


def line_of_sight(position: FloatArray, origin: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors to positions, (N, 2), and the distances, (N,)."""
    line = position - np.asarray(origin)
    distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
    return line / distance[:, None], distance


def to_plane(measurement: FloatArray, origin: Sequence[float], yaw: float) -> FloatArray:
    """Return the positions of measurements, shape (M, 2)."""
    bearing = measurement[:, 1] + yaw
    direction = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    position: FloatArray = np.asarray(origin) + measurement[:, :1] * direction
    return position


def error_axes(
    measurement: FloatArray, std: FloatArray, yaw: float
) -> tuple[FloatArray, FloatArray]:
    """Return the principal axes of positions' errors and the standard deviations along them.

    Measurements and standard deviations are (M, 2). The axes are along the line of sight and across
    it, unit vectors in columns, (M, 2, 2); the standard deviations along them are metres, (M, 2).
    """
    bearing = measurement[:, 1] + yaw
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    distance = np.maximum(measurement[:, 0], MIN_RANGE)
    sides = np.stack([std[:, 0], distance * std[:, 1]], axis=1)
    return np.stack([along, across], axis=2), sides


def may_have_swept(
    position: FloatArray,
    radius: FloatArray,
    origin: Sequence[float],
    yaw: float,
    gate: float,
    detections: Detections,
) -> BoolArray:
    """Return a mask of the circles around positions that an antenna may have swept, (T,).

    `gate` is the largest offset of a detection from the antenna's direction, radians. The antenna
    swept the coverage of the detections, and the azimuths of the detections themselves.
    """
    line = position - np.asarray(origin)
    distance = np.maximum(np.hypot(line[:, 0], line[:, 1]), MIN_RANGE)
    margin = np.arcsin(np.minimum(radius / distance, 1.0)) + gate
    azimuth = np.arctan2(line[:, 1], line[:, 0]) - yaw
    near: BoolArray = radius >= distance
    if (coverage := detections.coverage) is not None:
        offset = np.mod(azimuth + margin - coverage.start, FULL_TURN)
        near |= offset <= coverage.width + 2.0 * margin
    if len(detections):
        seen, first = np.sort(np.mod(detections.measurement[:, 1], FULL_TURN)), azimuth - margin
        following = seen[np.searchsorted(seen, np.mod(first, FULL_TURN)) % len(seen)]
        near |= np.mod(following - first, FULL_TURN) <= 2.0 * margin
    return near
