"""Prediction of Gaussians by motions that are linear only for a known turn rate.

The distance that a turn displaces a target grows with the product of its speed and its turn rate.
If the turn rate is uncertain, a linearisation at the mean predicts a velocity that is too long and
a covariance that is too small.
"""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray
from ...compilation import Bool1, Float1, Float3, Float4, Int1, compiled, inner
from ...state_space import PLANAR
from ...targets.turn_matrix import write_turn
from .blocks import SIZE, dot

OMEGA = PLANAR.turn_rate
# Nodes of the quadrature over the turn rate, in standard deviations, and their weights.
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


@inner
def _multiply(matrix: FloatArray, vector: FloatArray, product: FloatArray) -> None:
    """Write a matrix times a vector."""
    for i in range(SIZE):
        product[i] = dot(matrix[i], vector)


@inner
def _add_moved(
    share: float, matrix: FloatArray, covariance: FloatArray, cross: FloatArray, total: FloatArray
) -> None:
    """Add a share of a covariance that a matrix has transformed; `cross` is a row of scratch."""
    for i in range(SIZE):
        for k in range(SIZE):
            cross[k] = dot(matrix[i], covariance[k])
        for k in range(SIZE):
            total[i, k] += share * dot(cross, matrix[k])


@inner
def _write_turned(
    mean: FloatArray,
    covariance: FloatArray,
    dt: float,
    scratch: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    later: FloatArray,
    jacobian: FloatArray,
    curved: FloatArray,
) -> None:
    """Write the results of `moved` for a Gaussian that turns at an uncertain rate."""
    given, matrix, each, slope, at = scratch
    std = math.sqrt(covariance[OMEGA, OMEGA])
    # Change of the state by one standard deviation of the turn rate.
    for i in range(SIZE):
        slope[i], later[i] = covariance[i, OMEGA] / std, 0.0
    for i in range(SIZE):
        for k in range(SIZE):
            given[i, k] = covariance[i, k] - slope[i] * slope[k]
            jacobian[i, k] = 0.0
    for node in range(len(NODES)):
        for i in range(SIZE):
            at[i] = mean[i] + NODES[node] * slope[i]
        write_turn(at[OMEGA], dt, matrix)
        _multiply(matrix, at, each[node])
        for i in range(SIZE):
            later[i] += WEIGHTS[node] * each[node, i]
            for k in range(SIZE):
                jacobian[i, k] += WEIGHTS[node] * matrix[i, k]
        _add_moved(WEIGHTS[node], matrix, given, at, curved)
    # The column of the turn rate follows from the covariance of the states before and after.
    for i in range(SIZE):
        total = 0.0
        for node in range(len(NODES)):
            total += WEIGHTS[node] * NODES[node] * each[node, i]
        rest = dot(jacobian[i], slope) - jacobian[i, OMEGA] * slope[OMEGA]
        jacobian[i, OMEGA] = (total - rest) / slope[OMEGA]
    for node in range(len(NODES)):
        for i in range(SIZE):
            apart = WEIGHTS[node] * (each[node, i] - later[i])
            for k in range(SIZE):
                curved[i, k] += apart * (each[node, k] - later[k])
    _add_moved(-1.0, jacobian, covariance, at, curved)


@compiled
def moved(
    mean: Float3,
    covariance: Float4,
    row: Int1,
    of: Int1,
    to: Int1,
    source: Int1,
    turns: Bool1,
    transition: Float4,
    dt: Float1,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the moments of Gaussians that have moved, without process noise.

    Parameters
    ----------
    mean, covariance : arrays of shape (H, R, D) and (H, R, D, D)
    row, of, to, source : int arrays of shape (A,)
        Row and mode of each Gaussian, the mode with which it moves, and the index of its interval.
    turns : bool array of shape (R,)
        Whether a mode is a coordinated turn. Others are linear.
    transition : array of shape (I, R, D, D)
        Matrix of each linear mode over each interval.
    dt : array of shape (I,)
        Seconds.

    Returns
    -------
    mean : array of shape (A, D)
    jacobian : array of shape (A, D, D)
        Mean J of the Jacobian: the covariance of the states before and after is P J'. Derivatives
        by a turn rate that is known are left out.
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
    count = len(row)
    later, jacobian = np.empty((count, SIZE)), np.zeros((count, SIZE, SIZE))
    curved = np.zeros((count, SIZE, SIZE))
    given, matrix = np.empty((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    scratch = given, matrix, np.empty((len(NODES), SIZE)), np.empty(SIZE), np.empty(SIZE)
    for pair in range(count):
        own, spread = mean[row[pair], of[pair]], covariance[row[pair], of[pair]]
        time, mode = dt[source[pair]], to[pair]
        if turns[mode] and spread[OMEGA, OMEGA] > 0.0:
            _write_turned(own, spread, time, scratch, later[pair], jacobian[pair], curved[pair])
            continue
        if turns[mode]:
            write_turn(own[OMEGA], time, jacobian[pair])
        else:
            for i in range(SIZE):
                for k in range(SIZE):
                    jacobian[pair, i, k] = transition[source[pair], mode, i, k]
        _multiply(jacobian[pair], own, later[pair])
    return later, jacobian, curved
