"""Prediction of Gaussians by motions that are linear only for a known turn rate.

The distance that a turn displaces a target grows with the product of its speed and its turn rate.
If the turn rate is uncertain, a linearisation at the mean predicts a velocity that is too long and
a covariance that is too small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray, IntArray, contiguous
from ...compilation import Float1, Float2, Float3, Float4, compiled, inner
from ...targets.motion import MotionModel
from .blocks import SIZE, dot

# Nodes of the quadrature over the turn rate, in standard deviations, and their weights.
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


def moved(
    mean: FloatArray,
    covariance: FloatArray,
    to: IntArray,
    dt: FloatArray,
    motions: Sequence[MotionModel],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the moments of Gaussians that have moved, without process noise.

    Parameters
    ----------
    mean, covariance : arrays of shape (A, D) and (A, D, D)
    to : int array of shape (A,)
        Index of each one's motion.
    dt : array of shape (A,)
        Seconds.
    motions : sequence of R MotionModel

    Returns
    -------
    mean : array of shape (A, D)
    jacobian : array of shape (A, D, D)
        Mean J of the Jacobian: the covariance of the states before and after is P J'.
    curved : array of shape (A, D, D)
        Difference of the later covariance and J P J'.

    Notes
    -----
    A motion is linear given the turn rate w, so that mean and covariance given w are exact, and are
    averaged over w by a Gauss-Hermite quadrature. The mean Jacobian is that of the statistical
    linear regression, by Stein's lemma.

    References
    ----------
    Sarkka, "Bayesian Filtering and Smoothing", Cambridge University Press, 2013, chapters 5 and 9.
    """
    later, jacobian = np.empty_like(mean), np.empty_like(covariance)
    curved = np.zeros_like(covariance)
    for mode, motion in enumerate(motions):
        own = np.flatnonzero(to == mode)
        turn = motion.space.turn_rate
        variance = covariance[own, turn, turn]
        if turn not in motion.support or not (variance > 0.0).any():
            later[own] = motion.mean(mean[own], dt[own])
            jacobian[own] = motion.jacobian(mean[own], dt[own])
            continue
        before = mean[own], covariance[own]
        later[own], jacobian[own], curved[own] = _turned(*before, variance, dt[own], motion)
    return later, jacobian, curved


def _turned(
    mean: FloatArray,
    covariance: FloatArray,
    variance: FloatArray,
    dt: FloatArray,
    motion: MotionModel,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the results of `moved` for a motion that turns; `variance` is the turn rate's."""
    count, size = mean.shape
    std = np.sqrt(variance)
    # Change of the state by one standard deviation of the turn rate.
    slope = covariance[:, :, motion.space.turn_rate] / np.where(std > 0.0, std, 1.0)[:, None]
    at = (mean + NODES[:, None, None] * slope).reshape(-1, size)
    times = np.tile(dt, len(NODES))
    each = motion.mean(at, times).reshape(-1, count, size)
    jacobian = motion.jacobian(at, times).reshape(-1, count, size, size)
    columns = contiguous(each, jacobian, covariance, slope)
    return _averaged(motion.space.turn_rate, NODES, WEIGHTS, *columns)


@inner
def _add_moved(share: float, matrix: FloatArray, covariance: FloatArray, total: FloatArray) -> None:
    """Add a share of a covariance that a matrix has transformed."""
    cross = np.empty(SIZE)
    for i in range(SIZE):
        for k in range(SIZE):
            cross[k] = dot(matrix[i], covariance[k])
        for k in range(SIZE):
            total[i, k] += share * dot(cross, matrix[k])


@compiled
def _averaged(
    turn: int,
    nodes: Float1,
    weights: Float1,
    each: Float3,
    jacobian: Float4,
    covariance: Float3,
    slope: Float2,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the results of `moved`, given means and Jacobians at the nodes of the turn rate.

    `slope` is the change of the state before by one standard deviation of the turn rate.
    """
    count = each.shape[1]
    later, average = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    curved, given = np.zeros((count, SIZE, SIZE)), np.empty((SIZE, SIZE))
    for row in range(count):
        for i in range(SIZE):
            for k in range(SIZE):
                given[i, k] = covariance[row, i, k] - slope[row, i] * slope[row, k]
        for node in range(len(nodes)):
            for i in range(SIZE):
                later[row, i] += weights[node] * each[node, row, i]
                for k in range(SIZE):
                    average[row, i, k] += weights[node] * jacobian[node, row, i, k]
        if slope[row, turn] > 0.0:
            # The column of the turn rate follows from the covariance of the states before and
            # after, which the nodes give more exactly than the mean of the derivatives.
            for i in range(SIZE):
                total = 0.0
                for node in range(len(nodes)):
                    total += weights[node] * nodes[node] * each[node, row, i]
                rest = dot(average[row, i], slope[row]) - average[row, i, turn] * slope[row, turn]
                average[row, i, turn] = (total - rest) / slope[row, turn]
        for node in range(len(nodes)):
            _add_moved(weights[node], jacobian[node, row], given, curved[row])
            for i in range(SIZE):
                apart = weights[node] * (each[node, row, i] - later[row, i])
                for k in range(SIZE):
                    curved[row, i, k] += apart * (each[node, row, k] - later[row, k])
        _add_moved(-1.0, average[row], covariance[row], curved[row])
    return later, average, curved
