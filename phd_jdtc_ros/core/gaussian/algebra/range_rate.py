"""The update of Gaussians with a range rate, after the update with range and azimuth.

The noise of a range rate is independent of the noise of range and azimuth, so that the two updates
may be done in turn. The range rate is linearised at the position after the first. The remaining
curvature is the product of the errors in angle and in the velocity across the line of sight; its
variance is added to the noise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...compilation import Float1, Float2, Float3, Int1, compiled, inner
from ...sensors.of_gaussians.linearised import NO_TIMES
from ...sensors.polar_geometry import MIN_RANGE
from ...sensors.range_rate import RangeRateModel, Rates
from ...sensors.sensor import Sensor
from . import kalman
from .blocks import product

# Sine of the angle from the zenith below which a line of sight has no direction across it.
LEAST_LEVEL = 1e-6


class RateUpdate(NamedTuple):
    """Gaussians after their range rates."""

    mean: FloatArray  # (N, D)
    covariance: FloatArray  # (N, D, D)
    # Log likelihood of the range rate alone, summed over all folds, (N,); 0 where there is none.
    log_likelihood: FloatArray
    innovation: FloatArray  # In the nearest fold, metres per second, (N,); 0 where there is none
    variance: FloatArray  # Variance of the innovation, (N,)


class Expected(NamedTuple):
    """Expected range rates of Gaussians."""

    rate: FloatArray  # Expected range rate, metres per second, (N,)
    cross: FloatArray  # Covariance of the range rate with the state, (N, D)
    variance: FloatArray  # Variance without the radar's noise, (N,)


def expected_at(expected: Expected, measured: Rates) -> Expected:
    """Return what the range rates of a plane are at the elevations of measured ones, row by row."""
    level = measured.level
    if level is None:
        return expected
    rate, cross, variance = expected
    return Expected(level * rate, level[:, None] * cross, level**2 * variance)


def expected_rates(
    mean: FloatArray, covariance: FloatArray, sensor: Sensor, time_s: FloatArray | None = None
) -> Expected:
    """Return the expected range rates of Gaussians at a radar.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp.
    time_s : array of shape (N,) or None
        Time of each measurement relative to the stamp, seconds.

    Notes
    -----
    With the line of sight u, the direction n across it, the distance r and the velocity v relative
    to the radar, the range rate is u'v. Errors dp and dv of position and velocity change it by
    (n'v) a + u'dv + a (n'dv) - (u'v) a^2 / 2, where a = n'dp / r is the error in angle. With the
    variances A and B of a and n'dv and their covariance C, the last two terms have the mean
    C - (u'v) A / 2 and approximately the variance A B + C^2 + (u'v)^2 A^2 / 2.
    """
    if sensor.space.vertical:
        return _expected_in_space(mean, covariance, sensor, time_s)
    position_axes, velocity_axes = list(sensor.space.position), list(sensor.space.velocity)
    velocity = mean[:, velocity_axes]
    line = mean[:, position_axes] - np.asarray(sensor.position)
    if time_s is not None:
        line = line + time_s[:, None] * velocity
    distance = np.maximum(np.sqrt((line**2).sum(axis=1)), MIN_RANGE)
    along = line / distance[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    relative = velocity - np.asarray(sensor.velocity)
    rate, side = (relative * along).sum(axis=1), (relative * across).sum(axis=1)

    angle, sideways, gradient = np.zeros_like(mean), np.zeros_like(mean), np.zeros_like(mean)
    angle[:, position_axes] = across / distance[:, None]
    if time_s is not None:
        angle[:, velocity_axes] = time_s[:, None] * angle[:, position_axes]
    sideways[:, velocity_axes] = across
    gradient[:, velocity_axes] = along
    gradient += side[:, None] * angle
    angle_covariance = _multiply(covariance, angle)
    sideways_covariance = _multiply(covariance, sideways)
    a, b = (angle_covariance * angle).sum(axis=1), (sideways_covariance * sideways).sum(axis=1)
    c = (angle_covariance * sideways).sum(axis=1)
    cross = _multiply(covariance, gradient)
    second_order = a * b + c**2 + 0.5 * (rate * a) ** 2
    return Expected(rate + c - 0.5 * rate * a, cross, (cross * gradient).sum(axis=1) + second_order)


def _expected_in_space(
    mean: FloatArray, covariance: FloatArray, sensor: Sensor, time_s: FloatArray | None
) -> Expected:
    """Return the results of `expected_rates` with two directions across the line of sight.

    The errors a in angle and w of the velocity across are then vectors, with the covariances A and
    B, and C between them. The terms of second order, a'w - (u'v) a'a / 2, have the mean
    tr C - (u'v) tr A / 2 and approximately the variance tr(A B) + tr(C C) + (u'v)^2 tr(A A) / 2.
    """
    axes = np.array([*sensor.space.place, *sensor.space.motion])
    antenna = sensor.origin.ravel()
    times = NO_TIMES if time_s is None else time_s
    columns = map(np.ascontiguousarray, (axes, antenna, mean, covariance, times))
    return Expected(*_rates_in_space(*columns))


@inner
def _write_sight(line: FloatArray, distance: float, along: FloatArray, across: FloatArray) -> None:
    """Write the line of sight as a unit vector, and two unit vectors across it, (2, 3)."""
    for i in range(3):
        along[i] = line[i] / distance
    level = math.sqrt(along[0] * along[0] + along[1] * along[1])
    across[0, 0], across[0, 1], across[0, 2] = 1.0, 0.0, 0.0
    if level > LEAST_LEVEL:  # Of a target overhead, any level direction is across.
        across[0, 0], across[0, 1] = -along[1] / level, along[0] / level
    across[1, 0] = -along[2] * across[0, 1]
    across[1, 1] = along[2] * across[0, 0]
    across[1, 2] = along[0] * across[0, 1] - along[1] * across[0, 0]


@compiled
def _rates_in_space(
    axes: Int1, antenna: Float1, mean: Float2, covariance: Float3, time_s: Float1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns of `Expected`.

    `axes` are those of the place before those of the velocity, and `antenna` has the sensor's.
    """
    count, size = mean.shape
    rate, cross, variance = np.empty(count), np.empty((count, size)), np.empty(count)
    line, speed, along, across = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    # Gradients of both angles, of both velocities across, and of the range rate, and their
    # covariances with the state.
    gradient, spread = np.empty((5, size)), np.empty((5, size))
    for row in range(count):
        time, square = time_s[row] if len(time_s) else 0.0, 0.0
        for i in range(3):
            speed[i] = mean[row, axes[3 + i]]
            line[i] = mean[row, axes[i]] + time * speed[i] - antenna[i]
            speed[i] -= antenna[3 + i]
            square += line[i] * line[i]
        distance = max(math.sqrt(square), MIN_RANGE)
        _write_sight(line, distance, along, across)
        radial = speed[0] * along[0] + speed[1] * along[1] + speed[2] * along[2]
        for k in range(5):
            for i in range(size):
                gradient[k, i] = 0.0
        for i in range(3):
            gradient[4, axes[3 + i]] = along[i]
        for k in range(2):
            side = speed[0] * across[k, 0] + speed[1] * across[k, 1] + speed[2] * across[k, 2]
            for i in range(3):
                angle = across[k, i] / distance
                gradient[k, axes[i]], gradient[k, axes[3 + i]] = angle, time * angle
                gradient[2 + k, axes[3 + i]] = across[k, i]
                gradient[4, axes[i]] += side * angle
                gradient[4, axes[3 + i]] += side * time * angle
        for k in range(5):
            for i in range(size):
                spread[k, i] = product(covariance[row, i], gradient[k])
        shift, second_order = 0.0, 0.0
        for k in range(2):
            shift += product(spread[k], gradient[2 + k])
            shift -= 0.5 * radial * product(spread[k], gradient[k])
            for n in range(2):
                a, b = product(spread[k], gradient[n]), product(spread[2 + k], gradient[2 + n])
                one = product(spread[k], gradient[2 + n])
                other = product(spread[n], gradient[2 + k])
                second_order += a * b + one * other + 0.5 * (radial * a) ** 2
        rate[row] = radial + shift
        variance[row] = product(spread[4], gradient[4]) + second_order
        for i in range(size):
            cross[row, i] = spread[4, i]
    return rate, cross, variance


def update_rates(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    measured: Rates,
    time_s: FloatArray | None = None,
) -> RateUpdate:
    """Return Gaussians updated with one range rate each; without one they are unchanged.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp, updated with range and azimuth.
    measured : Rates
        N range rates.
    time_s : array of shape (N,) or None
        Time of each measurement relative to the stamp, seconds.
    """
    in_plane = expected_rates(mean, covariance, sensor, time_s)
    return update_expected(mean, covariance, expected_at(in_plane, measured), measured)


def update_expected(
    mean: FloatArray, covariance: FloatArray, expected: Expected, measured: Rates
) -> RateUpdate:
    """Return Gaussians updated with one range rate each, given the expected ones.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp, updated with range and azimuth.
    expected : Expected
        Expected range rates of these Gaussians.
    measured : Rates
        N range rates; Gaussians without one are unchanged.

    Notes
    -----
    Where several folds are probable, their mixture is moment-matched by one Gaussian; see
    `RangeRateModel.fold`.
    """
    has_rate = np.isfinite(measured.rate)
    error = np.where(has_rate, measured.rate - expected.rate, 0.0)
    total = expected.variance + measured.std**2
    innovation, spread, log_density = measured.model.fold(error, total)
    gain = expected.cross / total[:, None]
    reduction = np.where(has_rate, total - spread, 0.0)
    updated_mean = mean + np.where(has_rate, innovation, 0.0)[:, None] * gain
    removed = reduction[:, None, None] * gain[:, :, None] * gain[:, None, :]
    updated_covariance = kalman.symmetric(covariance - removed)
    axes = np.arange(mean.shape[1])
    least = kalman.LEAST_VARIANCE * covariance[:, axes, axes]
    updated_covariance[:, axes, axes] = np.maximum(updated_covariance[:, axes, axes], least)
    log_likelihood = np.where(has_rate, log_density, 0.0)
    return RateUpdate(
        updated_mean, updated_covariance, log_likelihood, measured.model.wrap(error), total
    )


def folds_of(measured: Rates, rate: FloatArray, reach: float) -> FloatArray:
    """Return the range rates within `reach` of `rate`, a row per fold, shape (K, M)."""
    nearest = rate + measured.model.wrap(measured.rate - rate)
    folds: FloatArray = nearest + measured.model.folds(reach)[:, None]
    return folds


def unambiguous(measured: Rates, rate: FloatArray) -> Rates:
    """Return unambiguous range rates of these values."""
    return Rates(RangeRateModel(measured.model.std), rate, measured.std)


def _multiply(covariance: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (covariance @ vector[..., None])[..., 0]
    return product
