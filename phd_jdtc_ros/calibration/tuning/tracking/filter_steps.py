"""Steps of an extended Kalman filter for one track, compiled as parts of loops over plots.

State, measurement and motion are those of `kinematics`. A Gaussian is changed in its place.
"""

from __future__ import annotations

import math

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.compilation import inner
from phd_jdtc_ros.core.sensors.of_gaussians.angles import wrapped
from phd_jdtc_ros.core.sensors.polar_geometry import MIN_RANGE

# Range error, azimuth error, and the squared Mahalanobis distance and the determinant of the
# covariance of both.
Innovation = tuple[float, float, float, float]


@inner
def copy(
    mean: FloatArray, covariance: FloatArray, to_mean: FloatArray, to_covariance: FloatArray
) -> None:
    """Copy a Gaussian; an assignment of arrays would take seconds to compile."""
    for i in range(4):
        to_mean[i] = mean[i]
        for k in range(4):
            to_covariance[i, k] = covariance[i, k]


@inner
def predict(mean: FloatArray, covariance: FloatArray, dt: float, density: float) -> None:
    """Predict a Gaussian; `density` is that of the white acceleration, m^2/s^3."""
    for i in range(2):
        mean[i] += dt * mean[i + 2]
        for k in range(2):
            cross = covariance[i, k + 2] + covariance[k, i + 2]
            covariance[i, k] += dt * (cross + dt * covariance[i + 2, k + 2])
        covariance[i, i] += density * dt * dt * dt / 3.0
    for i in range(2):
        for k in range(2):
            covariance[i, k + 2] += dt * covariance[i + 2, k + 2]
        covariance[i, i + 2] += density * dt * dt / 2.0
        covariance[i + 2, i + 2] += density * dt
        covariance[2, i], covariance[3, i] = covariance[i, 2], covariance[i, 3]


@inner
def innovate(
    mean: FloatArray,
    covariance: FloatArray,
    measured: FloatArray,
    pose: FloatArray,
    variance: FloatArray,
    step: FloatArray,
) -> Innovation:
    """Return a plot's innovation; `variance` is that of range and azimuth.

    Write its covariance with the state, and the gain: both are (2, 4).
    """
    cross, gain = step[0], step[1]
    east, north = mean[0] - pose[0], mean[1] - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    ahead, left = cos * east + sin * north, cos * north - sin * east
    distance = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
    along, across = east / distance, north / distance
    for i in range(4):
        cross[0, i] = covariance[i, 0] * along + covariance[i, 1] * across
        cross[1, i] = (covariance[i, 1] * along - covariance[i, 0] * across) / distance
    a = along * cross[0, 0] + across * cross[0, 1] + variance[0]
    b = along * cross[1, 0] + across * cross[1, 1]
    d = (along * cross[1, 1] - across * cross[1, 0]) / distance + variance[1]
    determinant = a * d - b * b
    for i in range(4):
        gain[0, i] = (d * cross[0, i] - b * cross[1, i]) / determinant
        gain[1, i] = (a * cross[1, i] - b * cross[0, i]) / determinant
    range_error = measured[0] - distance
    azimuth_error = wrapped(measured[1] - math.atan2(left, ahead))
    square = d * range_error * range_error + a * azimuth_error * azimuth_error
    square = (square - 2.0 * b * range_error * azimuth_error) / determinant
    return range_error, azimuth_error, square, determinant


@inner
def update(
    probability: float,
    found: Innovation,
    step: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Update a Gaussian by an innovation that is of the target with a probability."""
    cross, gain = step[0], step[1]
    for i in range(4):
        mean[i] += probability * (gain[0, i] * found[0] + gain[1, i] * found[1])
        for k in range(i + 1):
            reduction = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
            covariance[i, k] -= probability * reduction
            covariance[k, i] = covariance[i, k]
