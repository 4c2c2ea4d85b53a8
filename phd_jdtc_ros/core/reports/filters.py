"""Kalman filters with two axes each of position, velocity and the antenna's offset.

The axes of a state are x, y, vx, vy and, of a pair, the offset ahead and to the left. Motions are
nearly of constant velocity; offsets do not change.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float1, Float2, Writeable, compiled, inner

# Floor of the pivots of covariances, relative to their diagonals.
LEAST_PIVOT = 1e-12


class State(NamedTuple):
    """Mean and covariance of a filter, (n,) and (n, n)."""

    mean: Float1
    covariance: Float2


class Link(NamedTuple):
    """An earlier state, given the present one x: its mean is shift + gain x."""

    shift: Float1
    gain: Float2
    rest: Float2  # Its covariance


@compiled
def predict(state: Writeable[State], dt: float, noise: float) -> None:
    """Predict a state in place; `noise` is the spectral density of the acceleration."""
    mean, covariance = state
    size = len(mean)
    for axis in range(2):
        mean[axis] += dt * mean[axis + 2]
        for k in range(size):
            covariance[axis, k] += dt * covariance[axis + 2, k]
    for axis in range(2):
        for k in range(size):
            covariance[k, axis] += dt * covariance[k, axis + 2]
    for axis in range(2):
        covariance[axis, axis] += noise * dt**3 / 3.0
        covariance[axis, axis + 2] += noise * dt**2 / 2.0
        covariance[axis + 2, axis] += noise * dt**2 / 2.0
        covariance[axis + 2, axis + 2] += noise * dt


def moved(
    mean: FloatArray, covariance: FloatArray, dt: FloatArray, noise: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return N states after times, or before them if negative, (N, n) and (N, n, n)."""
    motion = np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1))
    motion[:, 0, 2] = motion[:, 1, 3] = dt
    spread: FloatArray = motion @ covariance @ motion.swapaxes(1, 2)
    long = np.abs(dt)
    for axis in (0, 1):
        spread[:, axis, axis] += noise * long**3 / 3.0
        spread[:, axis, axis + 2] += noise * dt * long / 2.0
        spread[:, axis + 2, axis] += noise * dt * long / 2.0
        spread[:, axis + 2, axis + 2] += noise * long
    return (motion @ mean[:, :, None])[:, :, 0], spread


@inner
def factorise(matrix: FloatArray, size: int, factor: FloatArray) -> None:
    """Write the Cholesky factor of the leading rows of a covariance."""
    for i in range(size):
        for k in range(i + 1):
            total = matrix[i, k]
            for j in range(k):
                total -= factor[i, j] * factor[k, j]
            if i == k:
                factor[i, i] = math.sqrt(max(total, LEAST_PIVOT * max(matrix[i, i], 1e-9)))
            else:
                factor[i, k] = total / factor[k, k]


@compiled
def observe(
    state: Writeable[State], measured: Float1, matrix: Float2, noise: Float2, count: int
) -> tuple[float, float]:
    """Update a state in place with the first `count` components of a measurement.

    Return the log likelihood and the squared distance. `matrix` is (Z, n), `noise` (Z, Z).
    """
    mean, covariance = state
    size = len(mean)
    spread, residual = np.empty((count, size)), np.empty(count)
    total, factor = np.empty((count, count)), np.zeros((count, count))
    for i in range(count):
        residual[i] = measured[i]
        for k in range(size):
            residual[i] -= matrix[i, k] * mean[k]
            spread[i, k] = 0.0
            for j in range(size):
                spread[i, k] += matrix[i, j] * covariance[j, k]
    for i in range(count):
        for k in range(count):
            total[i, k] = noise[i, k]
            for j in range(size):
                total[i, k] += spread[i, j] * matrix[k, j]
    factorise(total, count, factor)
    square, log_scale = 0.0, 0.0
    # Solve for the residual and the spread, both in the units of the innovation.
    for i in range(count):
        for j in range(i):
            residual[i] -= factor[i, j] * residual[j]
            for k in range(size):
                spread[i, k] -= factor[i, j] * spread[j, k]
        residual[i] /= factor[i, i]
        for k in range(size):
            spread[i, k] /= factor[i, i]
        square += residual[i] ** 2
        log_scale += math.log(factor[i, i])
    for k in range(size):
        gained = 0.0
        for i in range(count):
            gained += spread[i, k] * residual[i]
        mean[k] += gained
        for j in range(size):
            lost = 0.0
            for i in range(count):
                lost += spread[i, k] * spread[i, j]
            covariance[k, j] -= lost
    return -0.5 * (square + count * math.log(2.0 * math.pi)) - log_scale, square


@compiled
def link_back(
    before: Writeable[State], after: Writeable[State], dt: float, link: Writeable[Link]
) -> None:
    """Extend the link from a state back to an earlier one by a prediction, in place.

    `before` and `after` are the state before the prediction and after it: the step is that of a
    Rauch-Tung-Striebel smoother.
    """
    mean, covariance = before
    later_mean, later = after
    size = len(mean)
    shift, gain, rest = link
    factor, cross = np.zeros((size, size)), np.empty((size, size))
    factorise(later, size, factor)
    for i in range(size):
        for k in range(size):
            cross[i, k] = covariance[i, k] + (dt * covariance[i, k + 2] if k < 2 else 0.0)
        # The gain's row: cross times the inverse of the predicted covariance.
        for k in range(size):
            for j in range(k):
                cross[i, k] -= factor[k, j] * cross[i, j]
            cross[i, k] /= factor[k, k]
        for step in range(size):
            k = size - 1 - step
            for j in range(k + 1, size):
                cross[i, k] -= factor[j, k] * cross[i, j]
            cross[i, k] /= factor[k, k]
    # The step's own shift and remaining covariance.
    own_shift, own_rest, scratch = np.empty(size), np.empty((size, size)), np.empty((size, size))
    for i in range(size):
        own_shift[i] = mean[i]
        for k in range(size):
            own_shift[i] -= cross[i, k] * later_mean[k]
            scratch[i, k] = 0.0
            for j in range(size):
                scratch[i, k] += cross[i, j] * later[j, k]
    for i in range(size):
        for k in range(size):
            own_rest[i, k] = covariance[i, k]
            for j in range(size):
                own_rest[i, k] -= scratch[i, j] * cross[k, j]
    for i in range(size):
        for k in range(size):
            shift[i] += gain[i, k] * own_shift[k]
            scratch[i, k] = 0.0
            for j in range(size):
                scratch[i, k] += gain[i, j] * own_rest[j, k]
    for i in range(size):
        for k in range(size):
            for j in range(size):
                rest[i, k] += scratch[i, j] * gain[k, j]
    for i in range(size):
        for k in range(size):
            scratch[i, k] = 0.0
            for j in range(size):
                scratch[i, k] += gain[i, j] * cross[j, k]
    for i in range(size):
        for k in range(size):
            gain[i, k] = scratch[i, k]
