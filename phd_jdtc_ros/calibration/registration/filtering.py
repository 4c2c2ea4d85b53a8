"""Estimates targets and the constant biases of all radars jointly, by a filter and least squares.

For given biases a target moves at nearly constant velocity, and several radars measure it. The
innovations of its filter are linear in the biases. Each filter therefore also propagates the
derivative of its mean with respect to every bias, and the sum over all innovations is a least
squares problem in the biases alone. It has the same information as the problem in all states and
biases (Rosenberg 1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from ..tuning import kinematics
from .sequences import BoolArray, Sequences

# The biases of one radar, in the order of a `RadarBias`, and the unit of each in the equations.
KINDS = ("range_bias", "range_gain", "azimuth", "time_offset_s")
UNITS = np.array([100.0, 1e-3, 1e-3, 0.1])
# Standard deviations of position and velocity before the first plot, m and m/s.
ANYWHERE, ANY_SPEED = 1e6, 1e3


@dataclass(frozen=True)
class Course:
    """Trajectories for the linearisation: positions (K, T, 2) and velocities (K, T, 2)."""

    position: FloatArray
    velocity: FloatArray


@dataclass(frozen=True)
class Pass:
    """The result of a filter's pass over all targets.

    Parameters
    ----------
    of_target : array of shape (T, P, P)
        Information matrix of the biases from each target, in `UNITS`, ordered by radar.
    score : array of shape (T, P)
        Right-hand side of the equations for each target.
    log_likelihood : float
        Log likelihood of the best biases.
    mean : array of shape (K, T, 4)
        Filtered x, y, vx, vy.
    response : array of shape (K, T, 4, P)
        Derivative of `mean` with respect to each bias.
    covariance : array of shape (K, T, 4, 4)
    """

    of_target: FloatArray
    score: FloatArray
    log_likelihood: float
    mean: FloatArray
    response: FloatArray
    covariance: FloatArray

    @property
    def information(self) -> FloatArray:
        """Information matrix from all targets, shape (P, P)."""
        total: FloatArray = self.of_target.sum(axis=0)
        return total

    def errors(self, free: BoolArray) -> FloatArray:
        """Return the biases that solve the equations, in `UNITS`, (P,); 0 if not free."""
        return _solve(self.information, self.score.sum(axis=0), free)


def _solve(information: FloatArray, score: FloatArray, free: BoolArray) -> FloatArray:
    found = np.zeros(len(score))
    rows = np.flatnonzero(free)
    found[rows] = np.linalg.lstsq(information[np.ix_(rows, rows)], score[rows], rcond=None)[0]
    return found


def filter_sequences(
    sequences: Sequences, course: Course, density: float, weight: FloatArray, radars: int
) -> Pass:
    """Filter the targets, and return the equations of the biases.

    Parameters
    ----------
    density : float
        Spectral density of the white acceleration, m^2/s^3.
    weight : array of shape (K, T)
        Weight of each plot, in (0, 1], which divides its standard deviations.
    """
    length, targets = sequences.radar.shape
    expected, jacobian = kinematics.linearise(course.position, sequences.pose)
    error = kinematics.innovation(sequences.measurement, expected)
    block = _block(expected, jacobian, course.velocity) * UNITS
    variance = (sequences.noise_std / weight[..., None]) ** 2
    mean = np.zeros((targets, 4))
    mean[:, :2] = course.position[0]
    covariance = np.tile(np.diag([ANYWHERE**2] * 2 + [ANY_SPEED**2] * 2), (targets, 1, 1))
    columns = len(KINDS) * radars
    response, score = np.zeros((targets, 4, columns)), np.zeros((targets, columns))
    of_target, log_likelihood = np.zeros((targets, columns, columns)), 0.0
    kept = np.zeros((length, targets, 4)), np.zeros((length, targets, 4, columns))
    covariances = np.zeros((length, targets, 4, 4))
    of_row, of_axis = np.arange(targets)[:, None, None], np.arange(2)[:, None]
    time_s = sequences.time_s
    for k in range(length):
        dt = time_s[k] - time_s[k - 1] if k else np.zeros(targets)
        mean, covariance = kinematics.predict(mean, covariance, dt, np.full(targets, density))
        response = response.copy()
        response[:, :2] += dt[:, None, None] * response[:, 2:]
        seen = np.zeros((targets, 2, columns))
        own = len(KINDS) * sequences.radar[k][:, None, None] + np.arange(len(KINDS))
        seen[of_row, of_axis, own] = block[k]
        slope = jacobian[k]
        innovation = error[k] - _times(slope, mean[:, :2] - course.position[k])
        shown = seen - slope @ response[:, :2]
        cross = covariance[:, :, :2] @ slope.swapaxes(1, 2)
        spread = slope @ cross[:, :2]
        spread[:, 0, 0] += variance[k, :, 0]
        spread[:, 1, 1] += variance[k, :, 1]
        inverted, determinant = kinematics.inverse(spread)
        there = sequences.there[k].astype(np.float64)
        weighted = there[:, None, None] * (inverted @ shown)
        of_target += shown.swapaxes(1, 2) @ weighted
        score += np.einsum("tip,ti->tp", weighted, innovation)
        square = np.einsum("ti,tij,tj->t", innovation, inverted, innovation)
        log_likelihood -= 0.5 * float(there @ (np.log(determinant) + square))
        gain = there[:, None, None] * (cross @ inverted)
        mean = mean + _times(gain, innovation)
        response = response + gain @ shown
        covariance = covariance - gain @ cross.swapaxes(1, 2)
        covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
        kept[0][k], kept[1][k], covariances[k] = mean, response, covariance
    total = score.sum(axis=0)
    best = _solve(of_target.sum(axis=0), total, np.ones(columns, dtype=bool))
    log_likelihood += 0.5 * float(best @ total)
    return Pass(of_target, score, log_likelihood, *kept, covariances)


def smooth_trajectories(
    sequences: Sequences, found: Pass, errors: FloatArray, density: float
) -> Course:
    """Return the smoothed trajectories, given the biases in `UNITS`, shape (P,).

    This is the recursion of Rauch, Tung and Striebel for the means alone.
    """
    mean = found.mean - found.response @ errors
    length, targets = sequences.radar.shape
    course = np.zeros((length, targets, 4))
    course[-1] = mean[-1]
    noise = np.full(targets, density)
    for k in range(length - 2, -1, -1):
        dt = sequences.time_s[k + 1] - sequences.time_s[k]
        ahead, grown = kinematics.predict(mean[k], found.covariance[k], dt, noise)
        cross = found.covariance[k].copy()
        cross[:, :, :2] += dt[:, None, None] * found.covariance[k][:, :, 2:]
        off = np.linalg.solve(grown, (course[k + 1] - ahead)[..., None])
        course[k] = mean[k] + (cross @ off)[..., 0]
    return Course(course[..., :2], course[..., 2:])


def _block(expected: FloatArray, jacobian: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the derivative of each plot with respect to its radar's biases, (K, T, 2, 4).

    A plot with a late time shows where its target was earlier.
    """
    block = np.zeros((*expected.shape, len(KINDS)))
    block[..., 0, 0] = 1.0
    block[..., 0, 1] = expected[..., 0]
    block[..., 1, 2] = 1.0
    block[..., 3] = -_times(jacobian, velocity)
    return block


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (matrix @ vector[..., None])[..., 0]
    return product
