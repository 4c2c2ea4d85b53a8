"""Prediction and iterated update of many Gaussians at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Float1, Float2, Float3, Int1, compiled, contiguous
from ...sensors.polar_radar import LEAST_RANGE, RadarModel
from .blocks import SIZE, wrapped

# Gauss-Newton steps of an update; two or three suffice unless a target is next to the radar.
ITERATIONS = 5
# Largest last step of a Gaussian, as a share of its range's standard deviation.
CONVERGED = 1e-2
# Least eigenvalue of a correlation matrix; smaller ones, and negative ones, are rounding.
LEAST_EIGENVALUE = 1e-10
# Of an updated variance, as a share of what it was before: doubles resolve no smaller one.
LEAST_VARIANCE = 1e-15
TINY = float(np.finfo(np.float64).tiny)


def predicted_covariance(
    covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return F P F' + Q, and the covariance P F' of the earlier and the later state."""
    cross = covariance @ _turned(transition)
    later = transition @ cross
    later += noise
    return symmetric(later), cross


class Located(NamedTuple):
    """Where a detection puts a target: the linearised measurement at the posterior position.

    Parameters
    ----------
    jacobian : array of shape (N, 2, 2)
        Of (range, azimuth) by the position at the detection's time.
    weighted : array of shape (N, 2)
        Innovation, times the inverse of its covariance.
    inverse : array of shape (N, 2, 2)
        Inverse of the innovation's covariance.
    log_likelihood : array of shape (N,)
        log N(z; h, S) of the measurement alone.
    """

    jacobian: FloatArray
    weighted: FloatArray
    inverse: FloatArray
    log_likelihood: FloatArray


@compiled
def _located(
    iterations: int,
    converged: float,
    mean: Float2,
    covariance: Float3,
    axes: Int1,
    pose: Float1,
    gaussian: Int1,
    column: Int1,
    measurement: Float2,
    noise_std: Float2,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the columns of `Located`.

    `axes` are those of the position and the velocity; `pose` is the radar's position and the cosine
    and the sine of its yaw.
    """
    count = len(gaussian)
    jacobian, inverse = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    weighted, log_likelihood = np.zeros((count, 2)), np.full(count, -np.inf)
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    at_x, at_y, cos, sin = pose[0], pose[1], pose[2], pose[3]
    for row in range(count):
        if gaussian[row] < 0:
            continue
        time, z, noise = time_s[column[row]], measurement[column[row]], noise_std[column[row]]
        state, spread = mean[gaussian[row]], covariance[gaussian[row]]
        prior_x, prior_y = state[x] + time * state[vx], state[y] + time * state[vy]
        p = spread[x, x] + time * (2.0 * spread[x, vx] + time * spread[vx, vx])
        q = spread[x, y] + time * (spread[x, vy] + spread[vx, y] + time * spread[vx, vy])
        r = spread[y, y] + time * (2.0 * spread[y, vy] + time * spread[vy, vy])
        noise_range, noise_azimuth = noise[0] ** 2, noise[1] ** 2
        limit = converged * noise[0]
        east, north = prior_x, prior_y
        j, k, a, b, d, determinant = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        along, across, weight_along, weight_across = 0.0, 0.0, 0.0, 0.0
        n, m = 0.0, 0.0
        for _ in range(iterations):
            line_x, line_y = east - at_x, north - at_y
            ahead, left = cos * line_x + sin * line_y, cos * line_y - sin * line_x
            distance = max(math.sqrt(ahead * ahead + left * left), LEAST_RANGE)
            j, k = line_x / distance, line_y / distance
            n, m = -k / distance, j / distance
            seen_x, seen_y = p * j + q * k, q * j + r * k
            turned_x, turned_y = p * n + q * m, q * n + r * m
            a = j * seen_x + k * seen_y + noise_range
            b = j * turned_x + k * turned_y
            d = n * turned_x + m * turned_y + noise_azimuth
            moved_x, moved_y = east - prior_x, north - prior_y
            along = z[0] - distance + (j * moved_x + k * moved_y)
            across = wrapped(z[1] - math.atan2(left, ahead))
            across += n * moved_x + m * moved_y
            determinant = max(a * d - b * b, TINY)
            weight_along = (d * along - b * across) / determinant
            weight_across = (a * across - b * along) / determinant
            before_x, before_y = east, north
            east = prior_x + seen_x * weight_along + turned_x * weight_across
            north = prior_y + seen_y * weight_along + turned_y * weight_across
            if max(abs(east - before_x), abs(north - before_y)) < limit:
                break
        jacobian[row, 0, 0], jacobian[row, 0, 1] = j, k
        jacobian[row, 1, 0], jacobian[row, 1, 1] = n, m
        inverse[row, 0, 0], inverse[row, 1, 1] = d / determinant, a / determinant
        inverse[row, 0, 1] = inverse[row, 1, 0] = -b / determinant
        weighted[row, 0], weighted[row, 1] = weight_along, weight_across
        square = along * weight_along + across * weight_across
        log_likelihood[row] = -0.5 * (square + math.log(determinant)) - math.log(2.0 * math.pi)
    return jacobian, weighted, inverse, log_likelihood


def located(
    mean: FloatArray,
    covariance: FloatArray,
    radar: RadarModel,
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray | None = None,
    iterations: int = ITERATIONS,
    converged: float = CONVERGED,
    pairs: tuple[IntArray, IntArray] | None = None,
) -> Located:
    """Return where polar measurements put Gaussian targets.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp.
    radar : RadarModel
    measurement, noise_std : arrays of shape (M, 2)
        Range in metres and azimuth in radians in the radar's frame; innovations are wrapped.
    time_s : array of shape (M,) or None
        Time of each measurement relative to the stamp, seconds; the target moves straight on until
        then.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter.
    converged : float
        Largest last step, as a share of the range's standard deviation.
    pairs : tuple of two int arrays of shape (P,), or None
        Gaussian and measurement of each pair; None if each Gaussian has the measurement of its row.
        Pairs without a Gaussian, -1, have a likelihood of zero and are left as they are.

    Notes
    -----
    A measurement depends on the position at its time alone. The posterior of that position is
    found by Gauss-Newton steps, and the likelihood is that of the measurement linearised there.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    count = len(measurement)
    gaussian, column = (np.arange(count), np.arange(count)) if pairs is None else pairs
    noise = np.broadcast_to(noise_std, measurement.shape)
    pose = *radar.position, np.cos(radar.yaw), np.sin(radar.yaw)
    return Located(
        *_located(
            iterations,
            converged,
            *contiguous(mean, covariance, _place_and_speed(radar), np.array(pose)),
            *contiguous(gaussian, column, measurement, noise, _times(time_s, count)),
        )
    )


@compiled
def _updated(
    mean: Float2,
    covariance: Float3,
    axes: Int1,
    gaussian: Int1,
    pair: Int1,
    jacobian: Float3,
    weighted: Float2,
    inverse: Float3,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray]:
    """Return the results of `updated`; `axes` as in `_located`."""
    count = len(gaussian)
    later_mean, later = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    x, y, vx, vy = axes[0], axes[1], axes[2], axes[3]
    cross, gain = np.empty((2, SIZE)), np.empty((2, SIZE))
    for row in range(count):
        at, spread = pair[row], covariance[gaussian[row]]
        later_mean[row], later[row] = mean[gaussian[row]], spread
        if at < 0:
            continue
        time, seen = time_s[at], jacobian[at]
        a, b, d = inverse[at, 0, 0], inverse[at, 0, 1], inverse[at, 1, 1]
        for i in range(SIZE):
            with_x = spread[i, x] + time * spread[i, vx]
            with_y = spread[i, y] + time * spread[i, vy]
            cross[0, i] = with_x * seen[0, 0] + with_y * seen[0, 1]
            cross[1, i] = with_x * seen[1, 0] + with_y * seen[1, 1]
            gain[0, i] = a * cross[0, i] + b * cross[1, i]
            gain[1, i] = b * cross[0, i] + d * cross[1, i]
            later_mean[row, i] += cross[0, i] * weighted[at, 0] + cross[1, i] * weighted[at, 1]
        for i in range(SIZE):
            for k in range(i + 1):
                taken = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
                later[row, i, k] = later[row, k, i] = spread[i, k] - taken
            # Of a variance that a precise measurement takes away, rounding may leave nothing.
            later[row, i, i] = max(later[row, i, i], LEAST_VARIANCE * spread[i, i])
    return later_mean, later


def updated(
    mean: FloatArray,
    covariance: FloatArray,
    radar: RadarModel,
    found: Located,
    time_s: FloatArray | None = None,
    pairs: tuple[IntArray, IntArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of Gaussians after what `located` found of them.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
    radar : RadarModel
    found : Located
        P of them.
    time_s : array of shape (P,) or None
        See `located`.
    pairs : tuple of two int arrays of shape (K,), or None
        Gaussian, and what was found of it; -1 leaves it as it is. None if they pair row by row.
    """
    every = np.arange(len(mean))
    gaussian, pair = (every, every) if pairs is None else pairs
    return _updated(
        *contiguous(mean, covariance, _place_and_speed(radar), gaussian, pair),
        *contiguous(found.jacobian, found.weighted, found.inverse),
        *contiguous(_times(time_s, len(found.weighted))),
    )


def floored(covariance: FloatArray) -> tuple[FloatArray, int]:
    """Return covariances without negative eigenvalues, and how many had some.

    Parameters
    ----------
    covariance : array of shape (..., D, D)
        Symmetric and finite; axes whose variance is zero are left out.
    """
    axes = np.arange(covariance.shape[-1])
    variance = covariance[..., axes, axes]
    checked = covariance.copy()
    checked[..., axes, axes] += variance == 0.0
    try:
        np.linalg.cholesky(checked)
    except np.linalg.LinAlgError:
        return _floored(covariance)
    return covariance, 0


def _floored(covariance: FloatArray) -> tuple[FloatArray, int]:
    axes = np.arange(covariance.shape[-1])
    variance = covariance[..., axes, axes]
    used = variance != 0.0
    std = np.sqrt(np.abs(np.where(used, variance, 1.0)))
    scale = std[..., None] * std[..., None, :]
    correlation = covariance / scale
    correlation[..., axes, axes] += ~used
    values, vectors = np.linalg.eigh(correlation)
    raised = (vectors * np.maximum(values, LEAST_EIGENVALUE)[..., None, :]) @ _turned(vectors)
    raised *= scale * used[..., None] * used[..., None, :]
    low = np.asarray((values < LEAST_EIGENVALUE).any(axis=-1))
    sound: FloatArray = np.where(low[..., None, None], symmetric(raised), covariance)
    return sound, int(np.count_nonzero(low))


def symmetric(matrix: FloatArray) -> FloatArray:
    """Return the symmetric part."""
    part: FloatArray = 0.5 * (matrix + _turned(matrix))
    return part


def _turned(matrix: FloatArray) -> FloatArray:
    turned: FloatArray = matrix.swapaxes(-1, -2)
    return turned


def _place_and_speed(radar: RadarModel) -> IntArray:
    return np.array([*radar.space.position, *radar.space.velocity])


def _times(time_s: FloatArray | None, count: int) -> FloatArray:
    return np.zeros(count) if time_s is None else time_s
