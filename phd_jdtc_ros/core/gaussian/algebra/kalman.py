"""Prediction and iterated update of many Gaussians at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, frozen
from ...compilation import SIZE, BySize, Float1, Float2, Float3, Int1, compiled, inner
from ...sensors.of_gaussians.linearised import NO_TIMES, Measured, Pairs, WeightedGaussians
from ...sensors.sensor import Sensor
from ...state_space import Z
from .blocks import copy_gaussian

# Smallest eigenvalue of a correlation matrix; smaller and negative ones are rounding errors.
LEAST_EIGENVALUE = 1e-10
# Smallest ratio of updated to prior variance that doubles resolve.
LEAST_VARIANCE = 1e-15


class Innovation(NamedTuple):
    """The innovation of a measurement, linearised at the posterior position."""

    # Jacobian of the measurement with respect to the position at the detection's time, (N, P, P),
    # where P is 2, or 3 in space.
    jacobian: Float3
    weighted: Float2  # Inverse of the innovation's covariance times the innovation, (N, P)
    inverse: Float3  # Inverse of the innovation's covariance, (N, P, P)
    log_likelihood: Float1  # Of the measurement alone, log N(z; h, S), (N,)


def innovations(
    gaussians: WeightedGaussians,
    sensor: Sensor,
    measured: Measured,
    pairs: tuple[IntArray, IntArray] | None = None,
    modes: int = 1,
    iterations: int = 5,
    converged: float = 1e-2,
) -> Innovation:
    """Return the innovations of measurements of Gaussians, by iterated linearisation.

    Parameters
    ----------
    gaussians : WeightedGaussians
        At the scan's stamp. Those without weight have a likelihood of zero.
    measured : Measured
        For a radar, range in metres and azimuth in radians in its frame; innovations are wrapped.
        The target moves on a straight line from the stamp to the time of its measurement. A
        correlation of errors is not used for a polar radar.
    pairs : tuple of two int arrays of shape (P,), or None
        Gaussian and measurement of each pair; None if each Gaussian has the measurement of its row.
        A pair with the Gaussian -1 has a likelihood of zero.
    modes : int
        Number of consecutive Gaussians that form a group. `pairs` has the indices of groups, and
        each pair has an innovation for each Gaussian of its group, one after the other.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter. Two or three
        suffice unless a target is next to the sensor.
    converged : float
        Step, as a share of the measurement's standard deviation, below which iteration ends.

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
        pairs = (np.arange(len(measured.measurement)),) * 2
    wanted = frozen(Pairs(*pairs, modes, iterations, converged))
    return frozen(Innovation(*sensor.of_gaussians.innovations(gaussians, measured, wanted)))


@BySize
@compiled
def _update(
    modes: int,
    axes: Int1,
    mean: Float2,
    covariance: Float3,
    group: Int1,
    pair: Int1,
    innovation_of: Innovation,
    time_s: Float1,
) -> tuple[FloatArray, FloatArray]:
    """Return the results of `update`; `axes` are those of the position before the velocity's."""
    jacobian, weighted, inverse, _ = innovation_of
    # Positions may be measured without a height in space, too.
    has_height = SIZE > Z and len(axes) > 4
    count, places = len(group) * modes, 3 if has_height else 2
    updated_mean, updated_covariance = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    cross, gain = np.empty((places, SIZE)), np.empty((places, SIZE))
    for row in range(count):
        gaussian = group[row // modes] * modes + row % modes
        innovation, spread = pair[row // modes] * modes + row % modes, covariance[gaussian]
        copy_gaussian(mean[gaussian], spread, updated_mean[row], updated_covariance[row])
        if pair[row // modes] < 0:
            continue
        time, slope = time_s[innovation] if len(time_s) else 0.0, jacobian[innovation]
        scale, weight = inverse[innovation], weighted[innovation]
        for i in range(SIZE):
            x = spread[i, axes[0]] + time * spread[i, axes[places]]
            y = spread[i, axes[1]] + time * spread[i, axes[places + 1]]
            z = spread[i, axes[2]] + time * spread[i, axes[5]] if has_height else 0.0
            for k in range(places):
                cross[k, i] = x * slope[k, 0] + y * slope[k, 1]
                if has_height:
                    cross[k, i] += z * slope[k, 2]
            added = cross[0, i] * weight[0] + cross[1, i] * weight[1]
            if has_height:
                added += cross[2, i] * weight[2]
            updated_mean[row, i] += added
            for k in range(places):
                gain[k, i] = scale[k, 0] * cross[0, i] + scale[k, 1] * cross[1, i]
                if has_height:
                    gain[k, i] += scale[k, 2] * cross[2, i]
        for i in range(SIZE):
            for k in range(i + 1):
                reduction = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
                if has_height:
                    reduction += gain[2, i] * cross[2, k]
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
    times = NO_TIMES if time_s is None else np.ascontiguousarray(time_s)
    axes = np.array([*sensor.space.place, *sensor.space.motion])
    group, pair = map(np.ascontiguousarray, pairs)
    mean, covariance = map(np.ascontiguousarray, (mean, covariance))
    update_pairs = _update[mean.shape[1]]
    return update_pairs(modes, axes, mean, covariance, group, pair, innovation, times)


def floor_eigenvalues(covariance: FloatArray) -> tuple[FloatArray, int]:
    """Return covariances without negative eigenvalues, and the number of those changed.

    Parameters
    ----------
    covariance : array of shape (..., D, D)
        Symmetric and finite; axes whose variance is zero are left out.
    """
    size = covariance.shape[-1]
    flat = np.ascontiguousarray(covariance).reshape(-1, size, size)
    indefinite = _find_indefinite[size](flat)
    if not len(indefinite):
        return covariance, 0
    sound = flat.copy()
    sound[indefinite], floored = _floor_eigenvalues(flat[indefinite])
    return sound.reshape(covariance.shape), floored


@inner
def is_positive(covariance: FloatArray, factor: FloatArray) -> bool:
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


@BySize
@compiled
def _find_indefinite(covariance: Float3) -> IntArray:
    """Return the rows of the matrices that are not positive definite on their axes."""
    indefinite, factor = np.zeros(len(covariance), np.bool_), np.empty((SIZE, SIZE))
    for row in range(len(covariance)):
        indefinite[row] = not is_positive(covariance[row], factor)
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
