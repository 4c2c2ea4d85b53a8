"""Estimates targets and the constant biases of all radars jointly, by a filter and least squares.

For given biases a target moves at nearly constant velocity, and several radars measure it. The
innovations of its filter are linear in the biases. Each filter therefore also propagates the
derivative of its mean with respect to every bias, and the sum over all innovations is a least
squares problem in the biases alone. It has the same information as the problem in all states and
biases (Rosenberg 1973).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import SensorBias

from ..tuning import kinematics
from .common import Sequences

# The biases of one radar, in the order of a `SensorBias`, and the unit of each in the equations.
KINDS = tuple(entry.name for entry in fields(SensorBias))
UNITS = np.array([100.0, 1e-3, 1e-3, 0.1])
# Standard deviations of position and velocity before the first plot, m and m/s.
ANYWHERE, ANY_SPEED = 1e6, 1e3


@dataclass(frozen=True)
class Trajectories:
    """Trajectories for the linearisation."""

    position: FloatArray  # (K, T, 2)
    velocity: FloatArray  # (K, T, 2)


class Pass:
    """The result of a filter's pass over T targets, with the normal equations of the P biases.

    The biases are in `UNITS`, ordered by radar. `information_of`, (T, P, P), and `score`, (T, P),
    are the information matrix and the right-hand side from each target. The filtered x, y, vx, vy
    are `mean`, (K, T, 4), with `covariance`, (K, T, 4, 4), and `response`, (K, T, 4, P), the
    derivative of the mean with respect to each bias.
    """

    def __init__(self, length: int, targets: int, biases: int) -> None:
        self.information_of = np.zeros((targets, biases, biases))
        self.score = np.zeros((targets, biases))
        self.mean = np.zeros((length, targets, 4))
        self.response = np.zeros((length, targets, 4, biases))
        self.covariance = np.zeros((length, targets, 4, 4))
        # Log likelihood without biases.
        self._log_likelihood = 0.0

    def add(self, found: kinematics.Innovation, sensitivity: FloatArray, valid: FloatArray) -> None:
        """Add an innovation of each target, with its sensitivity to the biases, (T, 2, P)."""
        weighted = valid[:, None, None] * (found.inverse @ sensitivity)
        self.information_of += sensitivity.swapaxes(1, 2) @ weighted
        self.score += np.einsum("tip,ti->tp", weighted, found.value)
        self._log_likelihood -= 0.5 * float(valid @ (np.log(found.determinant) + found.distance2))

    @property
    def information(self) -> FloatArray:
        """Information matrix from all targets, shape (P, P)."""
        total: FloatArray = self.information_of.sum(axis=0)
        return total

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the best biases."""
        score = self.score.sum(axis=0)
        best = self.bias_estimate(np.ones(len(score), dtype=bool))
        return self._log_likelihood + 0.5 * float(best @ score)

    def bias_estimate(self, free: BoolArray) -> FloatArray:
        """Return the least-squares estimate of the biases, shape (P,); 0 if not free."""
        rows = np.flatnonzero(free)
        information = self.information[np.ix_(rows, rows)]
        found = np.zeros(len(free))
        found[rows] = np.linalg.lstsq(information, self.score.sum(axis=0)[rows], rcond=None)[0]
        return found


def filter_targets(
    sequences: Sequences,
    trajectories: Trajectories,
    density: float,
    weight: FloatArray,
    radars: int,
) -> Pass:
    """Filter the targets, and return the equations of the biases.

    `density` is the spectral density of the white acceleration, m^2/s^3; the weights of the
    plots, (K, T), in (0, 1], divide their standard deviations.
    """
    length, targets = sequences.radar.shape
    expected, jacobian = kinematics.linearise(trajectories.position, sequences.pose)
    residual = kinematics.residual(sequences.measurement, expected)
    derivative = _derivative(sequences.radar, expected, jacobian, trajectories.velocity, radars)
    variance = (sequences.noise_std / weight[..., None]) ** 2
    found = Pass(length, targets, len(KINDS) * radars)
    mean = np.zeros((targets, 4))
    mean[:, :2] = trajectories.position[0]
    covariance = np.tile(np.diag([ANYWHERE**2] * 2 + [ANY_SPEED**2] * 2), (targets, 1, 1))
    response = np.zeros(found.response.shape[1:])
    time_s = sequences.time_s
    for k in range(length):
        dt = time_s[k] - time_s[k - 1] if k else np.zeros(targets)
        mean, covariance = kinematics.predict(mean, covariance, dt, np.full(targets, density))
        response = response.copy()
        response[:, :2] += dt[:, None, None] * response[:, 2:]
        slope, valid = jacobian[k], sequences.valid[k].astype(np.float64)
        value = residual[k] - _times(slope, mean[:, :2] - trajectories.position[k])
        innovation = kinematics.innovation_of(value, covariance, slope, variance[k])
        sensitivity = derivative[k] - slope @ response[:, :2]
        found.add(innovation, sensitivity, valid)
        gain = valid[:, None, None] * innovation.gain
        mean = mean + _times(gain, value)
        response = response + gain @ sensitivity
        covariance = covariance - gain @ innovation.cross.swapaxes(1, 2)
        covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
        found.mean[k], found.response[k], found.covariance[k] = mean, response, covariance
    return found


def smooth_targets(
    sequences: Sequences, found: Pass, biases: FloatArray, density: float
) -> Trajectories:
    """Return the Rauch-Tung-Striebel means, given the biases in `UNITS`, shape (P,)."""
    mean = found.mean - found.response @ biases
    length, targets = sequences.radar.shape
    state = np.zeros((length, targets, 4))
    state[-1] = mean[-1]
    noise = np.full(targets, density)
    for k in range(length - 2, -1, -1):
        dt = sequences.time_s[k + 1] - sequences.time_s[k]
        ahead, grown = kinematics.predict(mean[k], found.covariance[k], dt, noise)
        cross = found.covariance[k].copy()
        cross[:, :, :2] += dt[:, None, None] * found.covariance[k][:, :, 2:]
        off = np.linalg.solve(grown, (state[k + 1] - ahead)[..., None])
        state[k] = mean[k] + (cross @ off)[..., 0]
    return Trajectories(state[..., :2], state[..., 2:])


def _derivative(
    radar: IntArray, expected: FloatArray, jacobian: FloatArray, velocity: FloatArray, radars: int
) -> FloatArray:
    """Return the derivative of each plot with respect to all biases in `UNITS`, (K, T, 2, P).

    A plot with a late time shows its target at an earlier position.
    """
    own = np.zeros((*expected.shape, len(KINDS)))
    own[..., 0, 0] = 1.0
    own[..., 0, 1] = expected[..., 0]
    own[..., 1, 2] = 1.0
    own[..., 3] = -_times(jacobian, velocity)
    of_radar = np.eye(radars)[radar][..., None, :, None]
    every: FloatArray = of_radar * (own * UNITS)[..., None, :]
    return every.reshape(*expected.shape, -1)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (matrix @ vector[..., None])[..., 0]
    return product
