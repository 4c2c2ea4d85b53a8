"""Prediction, iterated update and backward step of many Gaussians at once.

Where numba is in use, the loops of `compiled` do most of this; they are equal up to rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ... import backend
from ...arrays import FloatArray, IntArray
from ...sensors.polar_radar import LEAST_RANGE, RadarModel, wrap_angle

# Gauss-Newton steps of an update; two or three suffice unless a target is next to the radar.
ITERATIONS = 5
# Largest last step of a Gaussian, as a share of its range's standard deviation.
CONVERGED = 1e-2
# Least eigenvalue of a correlation matrix; smaller ones, and negative ones, are rounding.
LEAST_EIGENVALUE = 1e-10
# Of an updated variance, as a share of what it was before: doubles resolve no smaller one.
LEAST_VARIANCE = 1e-15


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

    def take(self, rows: IntArray) -> Located:
        """Return those of these rows."""
        return Located(*(part[rows] for part in self))


def located(
    mean: FloatArray,
    covariance: FloatArray,
    radar: RadarModel,
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray | None = None,
    iterations: int = ITERATIONS,
    converged: float = CONVERGED,
) -> Located:
    """Return where one polar measurement each puts a Gaussian target.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp.
    radar : RadarModel
    measurement, noise_std : arrays of shape (N, 2)
        Range in metres and azimuth in radians in the radar's frame; innovations are wrapped.
    time_s : array of shape (N,) or None
        Time of each measurement relative to the stamp, seconds; the target moves straight on until
        then.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter.
    converged : float
        Largest last step, as a share of the range's standard deviation.

    Notes
    -----
    A measurement depends on the position at its time alone. The posterior of that position is
    found by Gauss-Newton steps, and the likelihood is that of the measurement linearised there.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    if loops := backend.compiled("gaussian.algebra"):
        pose = (*radar.position, np.cos(radar.yaw), np.sin(radar.yaw))
        return Located(
            *loops.located(
                *(flat(mean, 1), flat(covariance, 2), _place_and_speed(radar), pose),
                *(flat(measurement, 1), flat(noise_std, 1), _times(time_s, len(mean))),
                *(iterations, converged, LEAST_RANGE),
            )
        )
    prior, cross = positioned(mean, covariance, radar, time_s)
    spread = cross[..., _axes(radar.space.position), :]
    if time_s is not None:
        spread = spread + time_s[:, None, None] * cross[..., _axes(radar.space.velocity), :]
    noise, limit = noise_std**2, converged * noise_std[:, 0]
    at, rows = prior, np.arange(len(mean))
    found: list[FloatArray] = []
    for _ in range(iterations):
        expected, jacobian = radar.linearised(at)
        error = measurement - expected
        error[:, 1] = wrap_angle(error[:, 1])
        seen = spread @ _turned(jacobian)
        total = jacobian @ seen
        total[:, 0, 0] += noise[:, 0]
        total[:, 1, 1] += noise[:, 1]
        error += (jacobian @ (at - prior)[..., None])[..., 0]
        inverse, determinant = inverse_of_pairs(total)
        weighted = (inverse @ error[..., None])[..., 0]
        later = prior + (seen @ weighted[..., None])[..., 0]
        parts = [jacobian, weighted, inverse, (error * weighted).sum(axis=1), determinant]
        for whole, part in zip(found, parts, strict=False):
            whole[rows] = part
        found = found or parts
        step = np.abs(later - at)
        moving = np.flatnonzero(~(np.maximum(step[:, 0], step[:, 1]) < limit))
        if not len(moving):
            break
        rows, at = rows[moving], later[moving]
        measurement, noise, limit = measurement[moving], noise[moving], limit[moving]
        prior, spread = prior[moving], spread[moving]
    jacobian, weighted, inverse, square, determinant = found
    log_likelihood = -0.5 * (square + np.log(determinant)) - np.log(2.0 * np.pi)
    return Located(jacobian, weighted, inverse, log_likelihood)


def updated(
    mean: FloatArray,
    covariance: FloatArray,
    radar: RadarModel,
    found: Located,
    time_s: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of Gaussians after what `located` found of them."""
    later: FloatArray
    spread: FloatArray
    if loops := backend.compiled("gaussian.algebra"):
        later, spread = loops.updated(
            *(flat(mean, 1), flat(covariance, 2), _place_and_speed(radar)),
            *(found.jacobian, found.weighted, found.inverse, _times(time_s, len(mean))),
        )
    else:
        cross = positioned(mean, covariance, radar, time_s)[1] @ _turned(found.jacobian)
        later = mean + (cross @ found.weighted[..., None])[..., 0]
        spread = symmetric(covariance - cross @ found.inverse @ _turned(cross))
    axes = np.arange(mean.shape[-1])
    # Of a variance that a precise measurement takes away, rounding may leave nothing.
    least = LEAST_VARIANCE * covariance[..., axes, axes]
    spread[..., axes, axes] = np.maximum(spread[..., axes, axes], least)
    return later, spread


def positioned(
    mean: FloatArray, covariance: FloatArray, radar: RadarModel, time_s: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the positions at these times, (N, 2), and their covariances with the states."""
    place, speed = _axes(radar.space.position), _axes(radar.space.velocity)
    if time_s is None:
        return mean[..., place], covariance[..., place]
    position = mean[..., place] + time_s[..., None] * mean[..., speed]
    return position, covariance[..., place] + time_s[..., None, None] * covariance[..., speed]


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


def inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverses of covariances; of singular ones, those on the axes that they span."""
    try:
        found = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        found = np.linalg.pinv(matrix, hermitian=True)
    return np.asarray(found, dtype=np.float64)


def inverse_of_pairs(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverses and determinants of positive 2 x 2 matrices, shape (N, 2, 2)."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    determinant = np.maximum(a * d - b * b, np.finfo(float).tiny)
    inverse = np.empty_like(matrix)
    inverse[..., 0, 0], inverse[..., 1, 1] = d / determinant, a / determinant
    inverse[..., 0, 1] = inverse[..., 1, 0] = -b / determinant
    return inverse, determinant


def symmetric(matrix: FloatArray) -> FloatArray:
    """Return the symmetric part."""
    part: FloatArray = 0.5 * (matrix + _turned(matrix))
    return part


def _turned(matrix: FloatArray) -> FloatArray:
    turned: FloatArray = matrix.swapaxes(-1, -2)
    return turned


def _axes(axes: tuple[int, ...]) -> slice | list[int]:
    """Return axes as a slice where they are evenly spaced, which makes no copy."""
    step = axes[1] - axes[0]
    return slice(axes[0], axes[-1] + 1, step) if step > 0 else list(axes)


def flat(array: FloatArray, axes: int) -> FloatArray:
    """Return an array with all axes in one but these last ones, and contiguous."""
    shape = array.shape[array.ndim - axes :]
    return np.ascontiguousarray(array).reshape(-1, *shape)


def _place_and_speed(radar: RadarModel) -> tuple[int, ...]:
    return (*radar.space.position, *radar.space.velocity)


def _times(time_s: FloatArray | None, count: int) -> FloatArray:
    return np.zeros(count) if time_s is None else flat(time_s, 0)
