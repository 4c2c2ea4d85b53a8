"""Nearly constant velocity, and measurements of range and azimuth or of places, for Gaussians.

The state is x, y, vx, vy in the frame of the radar's poses, metres and metres per second. Leading
axes are free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors import polar_radar
from phd_jdtc_ros.core.sensors.polar_geometry import MIN_RANGE


def predict(
    mean: FloatArray, covariance: FloatArray, dt: FloatArray, noise_density: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return predicted means (..., 4) and covariances (..., 4, 4).

    `noise_density`, the spectral density of the white acceleration, m^2/s^3, and the time step
    `dt`, seconds, have the leading axes of the covariances, shape (...).
    """
    step = dt[..., None]
    moved = np.concatenate([mean[..., :2] + step * mean[..., 2:], mean[..., 2:]], axis=-1)
    place, cross, speed = covariance[..., :2, :2], covariance[..., :2, 2:], covariance[..., 2:, 2:]
    step = step[..., None]
    new_cross = cross + step * speed
    new_place = place + step * (cross.swapaxes(-1, -2) + new_cross)
    grown = np.empty((*np.broadcast_shapes(dt.shape, noise_density.shape), 4, 4))
    noise = noise_density[..., None, None] * np.eye(2)
    grown[..., :2, :2] = new_place + noise * step**3 / 3.0
    grown[..., :2, 2:] = new_cross + noise * step**2 / 2.0
    grown[..., 2:, :2] = grown[..., :2, 2:].swapaxes(-1, -2)
    grown[..., 2:, 2:] = speed + noise * step
    return moved, grown


def linearise(position: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (range, azimuth) of positions (..., 2), and the Jacobian (..., 2, 2) by the position.

    `pose`, shape (..., 3), is x, y and yaw of the radar.
    """
    return polar_radar.linearise(position, pose[..., :2], pose[..., 2])


def slope(position: FloatArray, pose: FloatArray, places: bool) -> FloatArray:
    """Return the Jacobian (..., 2, 2) of plots, polar or `places`, by their positions (..., 2)."""
    if not places:
        return linearise(position, pose)[1]
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    turned: FloatArray = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], axis=-2)
    return turned


def positions(measurement: FloatArray, pose: FloatArray, places: bool = False) -> FloatArray:
    """Return the positions (..., 2) of (range, azimuth) or (x, y) plots from poses (..., 3)."""
    if places:
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        x, y = measurement[..., 0], measurement[..., 1]
        turned: FloatArray = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        return pose[..., :2] + turned
    bearing = measurement[..., 1] + pose[..., 2]
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    position: FloatArray = pose[..., :2] + measurement[..., :1] * along
    return position


def residual(measured: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the difference of (range, azimuth) rows, azimuths wrapped, shape (..., 2)."""
    difference = measured - expected
    difference[..., 1] = wrap_angle(difference[..., 1])
    return difference


class Innovation(NamedTuple):
    """Innovations of (range, azimuth) plots in an extended Kalman filter."""

    value: FloatArray  # Metres and radians, (..., 2)
    cross: FloatArray  # Covariance of state and plot, (..., 4, 2)
    inverse: FloatArray  # Inverse of the innovation covariance, (..., 2, 2)
    determinant: FloatArray  # Determinant of the innovation covariance, (...)

    @property
    def distance2(self) -> FloatArray:
        """Squared Mahalanobis distances, shape (...)."""
        scaled = np.einsum("...ij,...j->...i", self.inverse, self.value)
        return np.asarray((scaled * self.value).sum(axis=-1))

    @property
    def gain(self) -> FloatArray:
        """Kalman gains, shape (..., 4, 2)."""
        return self.cross @ self.inverse


def innovation_of(
    value: FloatArray, covariance: FloatArray, jacobian: FloatArray, variance: FloatArray
) -> Innovation:
    """Return innovations of these values.

    `jacobian`, (..., 2, 2), is that of the plots by the position, and `variance`, (..., 2), has the
    variances of range and azimuth, m^2 and rad^2.
    """
    cross = covariance[..., :2] @ jacobian.swapaxes(-1, -2)
    matrix = jacobian @ cross[..., :2, :]
    matrix[..., 0, 0] += variance[..., 0]
    matrix[..., 1, 1] += variance[..., 1]
    return Innovation(value, cross, *inverse(matrix))


def inverse(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverses and the determinants of symmetric 2 x 2 matrices, shape (..., 2, 2)."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    determinant = a * d - b * b
    swapped = np.empty_like(matrix)
    swapped[..., 0, 0], swapped[..., 1, 1] = d, a
    swapped[..., 0, 1] = swapped[..., 1, 0] = -b
    return swapped / determinant[..., None, None], determinant


def initial_state(
    measurement: FloatArray,
    pose: FloatArray,
    variance: FloatArray,
    speed_std: float,
    places: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance after a first detection, with a velocity of mean 0.

    `measurement` (..., 2) and `pose` (..., 3); `variance`, shape (..., 2), in square metres and
    square radians, or both in square metres for `places`; `speed_std` is the standard deviation of
    the velocity along each axis, m/s.
    """
    bearing = pose[..., 2] if places else measurement[..., 1] + pose[..., 2]
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    mean = np.zeros((*bearing.shape, 4))
    mean[..., :2] = positions(measurement, pose, places)
    distance = np.maximum(measurement[..., 0], MIN_RANGE) if not places else np.ones_like(bearing)
    spread = variance[..., 0][..., None, None] * along[..., :, None] * along[..., None, :]
    sideways = (distance**2 * variance[..., 1])[..., None, None]
    spread = spread + sideways * across[..., :, None] * across[..., None, :]
    covariance = np.zeros((*spread.shape[:-2], 4, 4))
    covariance[..., :2, :2] = spread
    covariance[..., 2, 2] = covariance[..., 3, 3] = speed_std**2
    return np.broadcast_to(mean, (*spread.shape[:-2], 4)).copy(), covariance
