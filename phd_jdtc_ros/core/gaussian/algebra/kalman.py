"""Prediction, iterated update and backward step of many Gaussians at once.

With numba, the loops of `compiled` replace most of these functions; they agree up to rounding.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ... import backend
from ...arrays import FloatArray, IntArray
from ...sensors.polar_geometry import MIN_RANGE
from ...sensors.sensor import Sensor
from ...snapshot import MAX_STATE, floats

# Largest number of Gauss-Newton steps of an update; two or three suffice unless a target is next
# to the sensor.
ITERATIONS = 5
# An update has converged at a step below this share of the range's standard deviation.
CONVERGED = 1e-2
# Smallest eigenvalue of a correlation matrix; smaller and negative ones are rounding errors.
LEAST_EIGENVALUE = 1e-10
# Smallest ratio of updated to prior variance that doubles resolve.
LEAST_VARIANCE = 1e-15


# Bound on the entries of a backward step; metres per radian per second give the largest values.
MOST_GAIN = 1e15


class Backward(NamedTuple):
    """The backward step from a Gaussian's later distribution to its earlier one.

    Given a later distribution of mean m and covariance P, the earlier one has the mean
    ``offset + gain m`` and the covariance ``base + gain P gain'``.

    Parameters
    ----------
    gain : array of shape (..., D, D)
    offset : array of shape (..., D)
    base : array of shape (..., D, D)
    """

    gain: Annotated[FloatArray, floats("PKDD", -MOST_GAIN, MOST_GAIN)]
    offset: Annotated[FloatArray, floats("PKD", -MOST_GAIN, MOST_GAIN)]
    # A small difference of large covariances: rounding may leave it indefinite.
    base: Annotated[FloatArray, floats("PKDD", -(MAX_STATE**2), MAX_STATE**2)]

    def earlier(self, mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the earlier mean and covariance, given the later ones."""
        moved = (self.gain @ mean[..., None])[..., 0]
        return self.offset + moved, self.base + self.gain @ covariance @ _turned(self.gain)


def predicted_covariance(
    covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return F P F' + Q, and the covariance P F' of the earlier and the later state."""
    cross = covariance @ _turned(transition)
    later = transition @ cross
    later += noise
    return symmetric(later), cross


def backward(
    mean: FloatArray,
    covariance: FloatArray,
    later_mean: FloatArray,
    later: FloatArray,
    cross: FloatArray,
    unsupported: FloatArray,
) -> tuple[Backward, FloatArray]:
    """Return the backward steps of Gaussians, and the inverses of the later covariances.

    Parameters
    ----------
    mean, covariance : arrays of shape (..., D) and (..., D, D)
        Before the prediction.
    later_mean, later : arrays of shape (..., D) and (..., D, D)
        Predicted.
    cross : array of shape (..., D, D)
        Covariance of the earlier and the later state.
    unsupported : array of shape (..., D)
        1 for axes that the later state lacks, 0 otherwise.

    References
    ----------
    Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
    Journal 3(8), 1965: the gain is P F' P_predicted^-1.
    """
    if loops := backend.compiled("gaussian.algebra"):
        every = np.broadcast_to(unsupported, mean.shape)
        parts = (mean, covariance, later_mean, later, cross, every)
        sound, precision, *found = loops.backward(
            *(flat(part, axes) for part, axes in zip(parts, (1, 2, 1, 2, 2, 1), strict=True))
        )
        if sound:
            found = [part.reshape(*mean.shape[:-1], *part.shape[1:]) for part in found]
            return Backward(*found), precision.reshape(covariance.shape)
    size = mean.shape[-1]
    precision = inverse(later + unsupported[..., None] * np.eye(size))
    gain = cross @ precision
    base = covariance - gain @ _turned(cross)
    offset = mean - (gain @ later_mean[..., None])[..., 0]
    return Backward(gain, offset, symmetric(base)), precision


class Innovation(NamedTuple):
    """The innovation of a measurement, linearised at the posterior position.

    Parameters
    ----------
    jacobian : array of shape (N, 2, 2)
        Jacobian of the measurement with respect to the position at the detection's time.
    weighted : array of shape (N, 2)
        Inverse of the innovation's covariance times the innovation.
    inverse : array of shape (N, 2, 2)
        Inverse of the innovation's covariance.
    log_likelihood : array of shape (N,)
        log N(z; h, S) of the measurement alone.
    """

    jacobian: FloatArray
    weighted: FloatArray
    inverse: FloatArray
    log_likelihood: FloatArray

    def take(self, rows: IntArray) -> Innovation:
        """Return the innovations of these rows."""
        return Innovation(*(part[rows] for part in self))


def iterated_update(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    measurement: FloatArray,
    noise_std: FloatArray,
    time_s: FloatArray | None = None,
    iterations: int = ITERATIONS,
    converged: float = CONVERGED,
) -> Innovation:
    """Return the innovation of one measurement of each Gaussian, by iterated linearisation.

    Parameters
    ----------
    mean, covariance : arrays of shape (N, D) and (N, D, D)
        At the scan's stamp.
    measurement, noise_std : arrays of shape (N, 2)
        In the units of the sensor; innovations are wrapped.
    time_s : array of shape (N,) or None
        Time of each measurement relative to the stamp, seconds; the target moves on a straight
        line from the stamp to that time.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter.
    converged : float
        Step, as a share of the first component's standard deviation, below which iteration ends.

    Notes
    -----
    A measurement depends only on the position at its time. Gauss-Newton steps find the posterior
    position, and the likelihood is computed from the measurement linearised there.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    loops = backend.compiled("gaussian.algebra")
    if loops is not None and sensor.polar:
        pose = (*sensor.position, np.cos(sensor.yaw), np.sin(sensor.yaw))
        return Innovation(
            *loops.iterated_update(
                *(flat(mean, 1), flat(covariance, 2), _place_and_speed(sensor), pose),
                *(flat(measurement, 1), flat(noise_std, 1), _times(time_s, len(mean))),
                *(iterations, converged, MIN_RANGE),
            )
        )
    prior, cross = position_at(mean, covariance, sensor, time_s)
    spread = cross[..., _axes(sensor.space.position), :]
    if time_s is not None:
        spread = spread + time_s[:, None, None] * cross[..., _axes(sensor.space.velocity), :]
    noise, limit = noise_std**2, converged * noise_std[:, 0]
    at, rows = prior, np.arange(len(mean))
    found: list[FloatArray] = []
    for _ in range(iterations):
        expected, jacobian = sensor.linearise(at)
        error = sensor.wrap(measurement - expected)
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
    return Innovation(jacobian, weighted, inverse, log_likelihood)


def updated(
    mean: FloatArray,
    covariance: FloatArray,
    sensor: Sensor,
    innovation: Innovation,
    time_s: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the means and covariances of Gaussians after their innovations."""
    later: FloatArray
    spread: FloatArray
    if loops := backend.compiled("gaussian.algebra"):
        before = (flat(mean, 1), flat(covariance, 2), _place_and_speed(sensor))
        later, spread = loops.updated(*before, *innovation[:3], _times(time_s, len(mean)))
    else:
        cross = position_at(mean, covariance, sensor, time_s)[1] @ _turned(innovation.jacobian)
        later = mean + (cross @ innovation.weighted[..., None])[..., 0]
        spread = symmetric(covariance - cross @ innovation.inverse @ _turned(cross))
    axes = np.arange(mean.shape[-1])
    # Rounding may cancel a variance that a precise measurement reduces.
    least = LEAST_VARIANCE * covariance[..., axes, axes]
    spread[..., axes, axes] = np.maximum(spread[..., axes, axes], least)
    return later, spread


def position_at(
    mean: FloatArray, covariance: FloatArray, sensor: Sensor, time_s: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the positions at these times, (N, 2), and their covariances with the states."""
    place, speed = _axes(sensor.space.position), _axes(sensor.space.velocity)
    if time_s is None:
        return mean[..., place], covariance[..., place]
    position = mean[..., place] + time_s[..., None] * mean[..., speed]
    return position, covariance[..., place] + time_s[..., None, None] * covariance[..., speed]


def floor_eigenvalues(covariance: FloatArray) -> tuple[FloatArray, int]:
    """Return covariances without negative eigenvalues, and the number of those changed.

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
        return _floor_eigenvalues(covariance)
    return covariance, 0


def _floor_eigenvalues(covariance: FloatArray) -> tuple[FloatArray, int]:
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
    """Return the inverses of covariances, restricted to the axes of positive variance."""
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
    """Return a contiguous array with all but the last `axes` axes flattened into one."""
    shape = array.shape[array.ndim - axes :]
    return np.ascontiguousarray(array).reshape(-1, *shape)


def _place_and_speed(sensor: Sensor) -> tuple[int, ...]:
    return (*sensor.space.position, *sensor.space.velocity)


def _times(time_s: FloatArray | None, count: int) -> FloatArray:
    return np.zeros(count) if time_s is None else flat(time_s, 0)
