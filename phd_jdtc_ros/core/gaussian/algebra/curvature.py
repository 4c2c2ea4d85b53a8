"""Prediction of Gaussians by motions that are linear only for a known turn rate.

The distance that a turn displaces a target grows with the product of its speed and its turn rate.
If the turn rate is uncertain, a linearisation at the mean predicts a velocity that is too long and
a covariance that is too small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...compilation import SIZE, Float1, Float2, Writeable, in_place, inner
from ...state_space import SPATIAL
from ...targets.turn_matrix import climb, turn, turn_terms, write_climb, write_turn
from .blocks import dot

OMEGA, Z = SPATIAL.turn_rate, SPATIAL.vertical[0]
# Nodes of the quadrature over the turn rate, in standard deviations, and their weights.
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


class Moved(NamedTuple):
    """A Gaussian that has moved, without process noise, with the working arrays."""

    mean: Float1  # (D,)
    cross: Float2  # Covariance of the states before and after, (D, D)
    covariance: Float2  # (D, D)
    matrix: Float2  # Mean of the motion's matrix, (D, D)
    # Product of the covariance given the turn rate, (D, D); 0 in the row of the turn rate.
    conditional: Float2
    node_mean: Float2  # Mean given each turn rate, (nodes, D)
    slope: Float1  # Change of the state by one standard deviation of the turn rate, (D,)
    point: Float1  # (D,)
    turned: Float1  # (D,)


@inner
def new_moved() -> Moved:
    """Return the arrays for one Gaussian at a time."""
    matrices = np.zeros((4, SIZE, SIZE))
    vectors = np.zeros((4, SIZE))
    first, second, third, last = matrices[0], matrices[1], matrices[2], matrices[3]
    node_mean = np.empty((len(NODES), SIZE))
    return Moved(
        vectors[0], first, second, third, last, node_mean, vectors[1], vectors[2], vectors[3]
    )


@inner
def _write_turn_moments(
    mean: FloatArray, covariance: FloatArray, arc: FloatArray, moved: Moved
) -> None:
    """Write the moments of a Gaussian that turns at an uncertain rate."""
    dt = arc[1] + arc[2]
    moved_mean, matrix, node_mean = moved.mean, moved.matrix, moved.node_mean
    slope, point = moved.slope, moved.point
    std = math.sqrt(covariance[OMEGA, OMEGA])
    along, across, cos, sin = 0.0, 0.0, 0.0, 0.0
    for i in range(SIZE):
        slope[i], moved_mean[i] = covariance[i, OMEGA] / std, 0.0
        for k in range(SIZE):
            matrix[i, k] = moved.covariance[i, k] = moved.cross[i, k] = 0.0
    for node in range(len(NODES)):
        for i in range(SIZE):
            point[i] = mean[i] + NODES[node] * slope[i]
        terms = turn_terms(point[OMEGA], arc)
        turn(terms, point, node_mean[node])
        if SIZE > Z:
            climb(dt, point, node_mean[node])
        along, across = along + WEIGHTS[node] * terms[0], across + WEIGHTS[node] * terms[1]
        cos, sin = cos + WEIGHTS[node] * terms[2], sin + WEIGHTS[node] * terms[3]
        for i in range(SIZE):
            moved_mean[i] += WEIGHTS[node] * node_mean[node, i]
        for i in range(SIZE):
            if i == OMEGA:  # The turn rate is given.
                continue
            for k in range(SIZE):
                point[k] = covariance[i, k] - slope[i] * slope[k]
            turn(terms, point, moved.conditional[i])
            if SIZE > Z:
                climb(dt, point, moved.conditional[i])
        for k in range(SIZE):
            if k == OMEGA:
                continue
            for i in range(SIZE):
                point[i] = moved.conditional[i, k]
            turn(terms, point, moved.turned)
            if SIZE > Z:
                climb(dt, point, moved.turned)
            for i in range(SIZE):
                moved.covariance[i, k] += WEIGHTS[node] * moved.turned[i]
    write_turn((along, across, cos, sin, arc[3]), matrix)
    if SIZE > Z:
        write_climb(dt, matrix)
    # The column of the turn rate follows from the covariance of the states before and after.
    for i in range(SIZE):
        total = 0.0
        for node in range(len(NODES)):
            total += WEIGHTS[node] * NODES[node] * node_mean[node, i]
        rest = dot(matrix[i], slope) - matrix[i, OMEGA] * slope[OMEGA]
        matrix[i, OMEGA] = (total - rest) / slope[OMEGA]
    for node in range(len(NODES)):
        for i in range(SIZE):
            deviation = WEIGHTS[node] * (node_mean[node, i] - moved_mean[i])
            for k in range(SIZE):
                moved.covariance[i, k] += deviation * (node_mean[node, k] - moved_mean[k])
    for i in range(SIZE):
        for k in range(SIZE):
            moved.cross[i, k] = dot(covariance[i], matrix[k])


@inner
def _write_linear_moments(mean: FloatArray, covariance: FloatArray, moved: Moved) -> None:
    """Write the moments of a Gaussian after a linear motion."""
    matrix, cross, spread = moved.matrix, moved.cross, moved.covariance
    for i in range(SIZE):
        moved.mean[i] = dot(matrix[i], mean)
        for k in range(SIZE):
            cross[i, k] = dot(covariance[i], matrix[k])
    for k in range(SIZE):
        for i in range(SIZE):
            moved.point[i] = cross[i, k]
        for i in range(k, SIZE):
            spread[i, k] = spread[k, i] = dot(matrix[i], moved.point)


@in_place
def move(
    mean: Float1,
    covariance: Float2,
    transition: Float2,
    turns: bool,
    arc: Float1,
    moved: Writeable[Moved],
) -> None:
    """Write the moments of a Gaussian that moves.

    Parameters
    ----------
    mean, covariance : arrays of shape (D,) and (D, D)
    transition : array of shape (D, D)
        Matrix of a linear motion.
    turns : bool
        Whether the motion is a coordinated turn instead.
    arc : array of shape (4,)
        Its `motion.turn_arc`.

    Notes
    -----
    A motion is linear given the turn rate w, so that mean and covariance given w are exact, and are
    averaged over w by a Gauss-Hermite quadrature. The covariance of the states before and after is
    P J', with the mean Jacobian J of the statistical linear regression, by Stein's lemma;
    derivatives by a turn rate that is known are left out.

    References
    ----------
    Sarkka, "Bayesian Filtering and Smoothing", Cambridge University Press, 2013, chapters 5 and 9.
    """
    if turns and covariance[OMEGA, OMEGA] > 0.0:
        _write_turn_moments(mean, covariance, arc, moved)
        return
    matrix = moved.matrix
    for i in range(SIZE):
        for k in range(SIZE):
            matrix[i, k] = 0.0 if turns else transition[i, k]
    if turns:
        write_turn(turn_terms(mean[OMEGA], arc), matrix)
        if SIZE > Z:
            write_climb(arc[1] + arc[2], matrix)
    _write_linear_moments(mean, covariance, moved)
