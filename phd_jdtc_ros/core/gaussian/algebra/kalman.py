"""Prediction and iterated update of many Gaussians at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, contiguous
from ...compilation import Float1, Float2, Float3, Int1, compiled, inner
from ...sensors.polar_geometry import MIN_RANGE
from ...sensors.sensor import Sensor
from . import linearised
from .blocks import SIZE, copy_gaussian, wrapped

# Largest number of Gauss-Newton steps of an update; two or three suffice unless a target is next
# to the sensor.
ITERATIONS = 5
# An update has converged at a step below this share of the range's standard deviation.
CONVERGED = 1e-2
# Smallest eigenvalue of a correlation matrix; smaller and negative ones are rounding errors.
LEAST_EIGENVALUE = 1e-10
# Smallest ratio of updated to prior variance that doubles resolve.
LEAST_VARIANCE = 1e-15
TINY = float(np.finfo(np.float64).tiny)
# Times of measurements that are all made at the stamp.
NO_TIMES = np.zeros(0)


class Innovation(NamedTuple):
    """The innovation of a measurement, linearised at the posterior position."""

    # Jacobian of the measurement with respect to the position at the detection's time, (N, 2, 2).
    # For a sensor that is not polar, `linearised.innovations` replaces the measurement by the
    # position.
    jacobian: FloatArray
    weighted: FloatArray  # Inverse of the innovation's covariance times the innovation, (N, 2)
    inverse: FloatArray  # Inverse of the innovation's covariance, (N, 2, 2)
    log_likelihood: FloatArray  # log N(z; h, S) of the measurement alone, (N,)


@inner
def _position_covariance(
    covariance: FloatArray, gaussian: int, axes: IntArray, time: float
) -> tuple[float, float, float]:
    """Return the covariance of a position some seconds after the stamp: xx, xy and yy."""
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    p, q, r = covariance[gaussian, x, x], covariance[gaussian, x, y], covariance[gaussian, y, y]
    if time != 0.0:
        crossed = covariance[gaussian, x, vy] + covariance[gaussian, vx, y]
        p += time * (2.0 * covariance[gaussian, x, vx] + time * covariance[gaussian, vx, vx])
        q += time * (crossed + time * covariance[gaussian, vx, vy])
        r += time * (2.0 * covariance[gaussian, y, vy] + time * covariance[gaussian, vy, vy])
    return p, q, r


@compiled
def _innovations(
    iterations: int,
    converged: float,
    modes: int,
    axes: Int1,
    pose: Float1,
    mean: Float2,
    covariance: Float3,
    weight: Float1,
    expected: Float2,
    group: Int1,
    column: Int1,
    measurement: Float2,
    noise_std: Float2,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the columns of `Innovation`; for the parameters see `innovations`.

    `axes` are those of the position and the velocity; `pose` is the radar's position, and the
    cosine and the sine of its yaw. `expected` is empty if it is unknown.
    """
    count = len(group) * modes
    jacobian, inverse = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    weighted, log_likelihood = np.zeros((count, 2)), np.full(count, -np.inf)
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    radar_x, radar_y, cos, sin = pose[0], pose[1], pose[2], pose[3]
    for row in range(count):
        pair = row // modes
        gaussian, detection = group[pair] * modes + row % modes, column[pair]
        if gaussian < 0 or not weight[gaussian] > 0.0:
            continue
        time = time_s[detection] if len(time_s) else 0.0
        prior_x = mean[gaussian, x] + time * mean[gaussian, vx]
        prior_y = mean[gaussian, y] + time * mean[gaussian, vy]
        p, q, r = _position_covariance(covariance, gaussian, axes, time)
        noise_range, noise_azimuth = noise_std[detection, 0] ** 2, noise_std[detection, 1] ** 2
        tolerance = converged * noise_std[detection, 0]
        east, north = prior_x, prior_y
        j, k, a, b, d, determinant = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        range_error, azimuth_error, range_weight, azimuth_weight = 0.0, 0.0, 0.0, 0.0
        n, m = 0.0, 0.0
        for step in range(iterations):
            line_x, line_y = east - radar_x, north - radar_y
            if step == 0 and time == 0.0 and len(expected):
                distance, azimuth = expected[gaussian, 0], expected[gaussian, 1]
            else:
                ahead, left = cos * line_x + sin * line_y, cos * line_y - sin * line_x
                distance = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
                azimuth = math.atan2(left, ahead)
            j, k = line_x / distance, line_y / distance
            n, m = -k / distance, j / distance
            range_x, range_y = p * j + q * k, q * j + r * k
            azimuth_x, azimuth_y = p * n + q * m, q * n + r * m
            a = j * range_x + k * range_y + noise_range
            b = j * azimuth_x + k * azimuth_y
            d = n * azimuth_x + m * azimuth_y + noise_azimuth
            shift_x, shift_y = east - prior_x, north - prior_y
            range_error = measurement[detection, 0] - distance + (j * shift_x + k * shift_y)
            azimuth_error = wrapped(measurement[detection, 1] - azimuth)
            azimuth_error += n * shift_x + m * shift_y
            determinant = max(a * d - b * b, TINY)
            range_weight = (d * range_error - b * azimuth_error) / determinant
            azimuth_weight = (a * azimuth_error - b * range_error) / determinant
            last_x, last_y = east, north
            east = prior_x + range_x * range_weight + azimuth_x * azimuth_weight
            north = prior_y + range_y * range_weight + azimuth_y * azimuth_weight
            if max(abs(east - last_x), abs(north - last_y)) < tolerance:
                break
        jacobian[row, 0, 0], jacobian[row, 0, 1] = j, k
        jacobian[row, 1, 0], jacobian[row, 1, 1] = n, m
        inverse[row, 0, 0], inverse[row, 1, 1] = d / determinant, a / determinant
        inverse[row, 0, 1] = inverse[row, 1, 0] = -b / determinant
        weighted[row, 0], weighted[row, 1] = range_weight, azimuth_weight
        square = range_error * range_weight + azimuth_error * azimuth_weight
        log_likelihood[row] = -0.5 * (square + math.log(determinant)) - math.log(2.0 * math.pi)
    return jacobian, weighted, inverse, log_likelihood


def innovations(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray | None = None,
    iterations: int = ITERATIONS,
    converged: float = CONVERGED,
    pairs: tuple[IntArray, IntArray] | None = None,
    weight: FloatArray | None = None,
    modes: int = 1,
    expected: FloatArray | None = None,
    correlation: FloatArray | None = None,
) -> Innovation:
    """Return the innovations of measurements of Gaussians, by iterated linearisation.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp.
    measurement, noise_std : arrays of shape (M, Z)
        For a radar, range in metres and azimuth in radians in its frame; innovations are wrapped.
    time_s : array of shape (M,) or None
        Time of each measurement relative to the stamp, seconds; the target moves on a straight
        line from the stamp to that time.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter.
    converged : float
        Step, as a share of the range's standard deviation, below which iteration ends; for a
        sensor that is not polar see `linearised.innovations`.
    pairs : tuple of two int arrays of shape (P,), or None
        Gaussian and measurement of each pair; None if each Gaussian has the measurement of its row.
        A pair with the Gaussian -1 has a likelihood of zero.
    weight : array of shape (N,) or None
        Gaussians without weight have a likelihood of zero.
    modes : int
        Number of consecutive Gaussians that form a group. `pairs` has the indices of groups, and
        each pair has an innovation for each Gaussian of its group, one after the other.
    expected : array of shape (N, 2) or None
        Expected measurements at the stamp, if they are known.
    correlation : array of shape (M,) or None
        Correlation of the errors of both components, for a sensor that is not polar.

    Notes
    -----
    A measurement depends only on the position at its time. Gauss-Newton steps find the posterior
    position, and the likelihood is computed from the measurement linearised there.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    if pairs is None:
        pairs = (np.arange(len(measurement)),) * 2
    gaussian, column = pairs
    noise = noise_std if noise_std.ndim == 2 else np.broadcast_to(noise_std, measurement.shape)
    weight = np.ones(len(mean)) if weight is None else weight
    if not sensor.polar:
        gaussian, column = gaussians_of_groups(gaussian, modes), column.repeat(modes)
        gaussian = np.where(weight[gaussian] > 0.0, gaussian, -1)
        pair_correlation = None if correlation is None else correlation[column]
        row = np.maximum(gaussian, 0)
        measured = (measurement[column], noise[column], pair_correlation)
        times = np.zeros(len(row)) if time_s is None else time_s[column]
        gaussians = mean[row], covariance[row], sensor, *measured, times
        result = Innovation(*linearised.innovations(*gaussians, iterations, converged))
        log_likelihood = np.where(gaussian >= 0, result.log_likelihood, -np.inf)
        return result._replace(log_likelihood=log_likelihood)
    if expected is None:
        expected = np.zeros((0, 2))
    return Innovation(
        *_innovations(
            *(iterations, converged, modes, sensor.axes, sensor.planar_pose),
            *contiguous(mean, covariance, weight, expected, gaussian, column),
            *contiguous(measurement, noise, NO_TIMES if time_s is None else time_s),
        )
    )


def gaussians_of_groups(group: IntArray, modes: int) -> IntArray:
    """Return the Gaussians of groups of `modes` rows, one after the other; -1 for group -1."""
    if modes == 1:
        return group
    gaussian: IntArray = np.maximum(group[:, None] * modes + np.arange(modes), -1).ravel()
    return gaussian


@compiled
def _update(
    modes: int,
    axes: Int1,
    mean: Float2,
    covariance: Float3,
    group: Int1,
    pair: Int1,
    jacobian: Float3,
    weighted: Float2,
    inverse: Float3,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray]:
    """Return the results of `update`; `axes` as in `_innovations`."""
    count = len(group) * modes
    updated_mean, updated_covariance = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    cross, gain = np.empty((2, SIZE)), np.empty((2, SIZE))
    for row in range(count):
        gaussian = group[row // modes] * modes + row % modes
        innovation, spread = pair[row // modes] * modes + row % modes, covariance[gaussian]
        copy_gaussian(mean[gaussian], spread, updated_mean[row], updated_covariance[row])
        if pair[row // modes] < 0:
            continue
        time, pair_jacobian = time_s[innovation] if len(time_s) else 0.0, jacobian[innovation]
        a, b, d = inverse[innovation, 0, 0], inverse[innovation, 0, 1], inverse[innovation, 1, 1]
        for i in range(SIZE):
            cross_x = spread[i, x] + time * spread[i, vx]
            cross_y = spread[i, y] + time * spread[i, vy]
            cross[0, i] = cross_x * pair_jacobian[0, 0] + cross_y * pair_jacobian[0, 1]
            cross[1, i] = cross_x * pair_jacobian[1, 0] + cross_y * pair_jacobian[1, 1]
            gain[0, i] = a * cross[0, i] + b * cross[1, i]
            gain[1, i] = b * cross[0, i] + d * cross[1, i]
            updated_mean[row, i] += (
                cross[0, i] * weighted[innovation, 0] + cross[1, i] * weighted[innovation, 1]
            )
        for i in range(SIZE):
            for k in range(i + 1):
                reduction = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
                updated_covariance[row, i, k] = updated_covariance[row, k, i] = (
                    spread[i, k] - reduction
                )
            # Rounding may cancel a variance that a precise measurement reduces.
            updated_covariance[row, i, i] = max(
                updated_covariance[row, i, i], LEAST_VARIANCE * spread[i, i]
            )
    return updated_mean, updated_covariance


def update(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    innovation: Innovation,
    time_s: FloatArray | None = None,
    pairs: tuple[IntArray, IntArray] | None = None,
    modes: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of Gaussians after their innovations.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
    innovation : Innovation
        P innovations.
    time_s : array of shape (P,) or None
        See `innovations`.
    pairs : tuple of two int arrays of shape (K,), or None
        Gaussian and innovation of each result; an innovation of -1 leaves the Gaussian as it is.
        None if they pair row by row.
    modes : int
        See `innovations`.
    """
    if pairs is None:
        pairs = (np.arange(len(mean)),) * 2
    times = NO_TIMES if time_s is None else time_s
    return _update(
        modes, *contiguous(sensor.axes, mean, covariance, *pairs, *innovation[:3], times)
    )


def floor_eigenvalues(covariance: FloatArray) -> tuple[FloatArray, int]:
    """Return covariances without negative eigenvalues, and the number of those changed.

    Parameters
    ----------
    covariance : array of shape (..., D, D)
        Symmetric and finite; axes whose variance is zero are left out.
    """
    size = covariance.shape[-1]
    flat = np.ascontiguousarray(covariance).reshape(-1, size, size)
    indefinite = _find_indefinite(flat)
    if not len(indefinite):
        return covariance, 0
    sound = flat.copy()
    sound[indefinite], floored = _floor_eigenvalues(flat[indefinite])
    return sound.reshape(covariance.shape), floored


@inner
def _is_positive(covariance: FloatArray, factor: FloatArray) -> bool:
    """Return whether a Cholesky factor exists, and write it; axes of zero variance are left out."""
    for i in range(SIZE):
        for k in range(i + 1):
            total = covariance[i, k]
            for n in range(k):
                total -= factor[i, n] * factor[k, n]
            if k < i:
                factor[i, k] = total / factor[k, k]
            elif covariance[i, i] == 0.0:
                factor[i, i] = 1.0
            elif total > 0.0:
                factor[i, i] = math.sqrt(total)
            else:
                return False
    return True


@compiled
def _find_indefinite(covariance: Float3) -> IntArray:
    """Return the rows of the matrices that are not positive definite on their axes."""
    indefinite, factor = np.zeros(len(covariance), np.bool_), np.empty((SIZE, SIZE))
    for row in range(len(covariance)):
        indefinite[row] = not _is_positive(covariance[row], factor)
    return np.flatnonzero(indefinite)


def _floor_eigenvalues(covariance: FloatArray) -> tuple[FloatArray, int]:
    axes = np.arange(covariance.shape[-1])
    variance = covariance[..., axes, axes]
    used = variance != 0.0
    std = np.sqrt(np.abs(np.where(used, variance, 1.0)))
    scale = std[..., None] * std[..., None, :]
    correlation = covariance / scale
    correlation[..., axes, axes] += ~used
    values, vectors = np.linalg.eigh(correlation)
    raised = (vectors * np.maximum(values, LEAST_EIGENVALUE)[..., None, :]) @ _transpose(vectors)
    raised *= scale * used[..., None] * used[..., None, :]
    low = np.asarray((values < LEAST_EIGENVALUE).any(axis=-1))
    sound: FloatArray = np.where(low[..., None, None], symmetric(raised), covariance)
    return sound, int(np.count_nonzero(low))


def symmetric(matrix: FloatArray) -> FloatArray:
    """Return the symmetric part."""
    part: FloatArray = 0.5 * (matrix + _transpose(matrix))
    return part


def _transpose(matrix: FloatArray) -> FloatArray:
    transposed: FloatArray = matrix.swapaxes(-1, -2)
    return transposed
