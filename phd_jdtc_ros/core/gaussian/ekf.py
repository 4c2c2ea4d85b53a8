# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Prediction and the iterated extended Kalman update of one Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..models.motion import MotionModel
from ..models.radar import RadarModel, wrap_angle

# Largest number of Gauss-Newton steps per measurement; two or three suffice unless a target is
# next to the radar.
ITERATIONS = 10
CONVERGED_M = 1e-3


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution.

    Parameters
    ----------
    mean : array of shape (D,)
    covariance : array of shape (D, D)
    """

    mean: FloatArray
    covariance: FloatArray


def transition_matrix(model: MotionModel, dt: float) -> FloatArray:
    """Return F(dt) of a linear motion model on its support, shape (D, D)."""
    support = list(model.support)
    matrix: FloatArray = model.mean(np.eye(len(model.space)), dt).T[np.ix_(support, support)]
    return matrix


def predict(before: Gaussian, transition: FloatArray, noise: FloatArray) -> Gaussian:
    """Return the distribution of ``F x + v``, where v has covariance `noise`; both (D, D)."""
    return Gaussian(
        transition @ before.mean,
        transition @ before.covariance @ transition.T + noise,
    )


def update(
    prior: Gaussian,
    radar: RadarModel,
    measurement: FloatArray,
    support: tuple[int, ...],
    iterations: int = ITERATIONS,
) -> Gaussian:
    """Return the posterior of one polar measurement by an iterated extended Kalman filter.

    Parameters
    ----------
    prior : Gaussian
    radar : RadarModel
    measurement : array of shape (2,)
        Range in metres, azimuth in radians in the radar's frame; its innovation is wrapped.
    support : tuple of D int
        Indices of the Gaussian's components in the state.
    iterations : int
        Largest number of linearisations; 1 is the plain extended Kalman filter.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    noise = np.diag(radar.noise_std**2)
    at = prior.mean
    for _ in range(iterations):
        expected, jacobian = _linearised(radar, at, support)
        innovation = measurement - expected
        innovation[1] = wrap_angle(innovation[1])
        spread = jacobian @ prior.covariance @ jacobian.T + noise
        gain = np.linalg.solve(spread, jacobian @ prior.covariance).T
        previous, at = at, prior.mean + gain @ (innovation - jacobian @ (prior.mean - at))
        if np.abs(at - previous).max() < CONVERGED_M:
            break
    # Joseph's form stays symmetric and positive definite.
    kept = np.eye(len(at)) - gain @ jacobian
    return Gaussian(at, kept @ prior.covariance @ kept.T + gain @ noise @ gain.T)


def _linearised(
    radar: RadarModel, mean: FloatArray, support: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return (range, azimuth) at a mean, shape (2,), and their derivatives, shape (2, D)."""
    position, size = list(radar.space.position), len(radar.space)
    state = np.zeros((1, size))
    state[0, list(support)] = mean
    expected = radar.measure(state)[0]
    east, north = state[0, position] - radar.position
    distance = expected[0]
    full = np.zeros((2, size))
    full[0, position] = np.array([east, north]) / distance
    full[1, position] = np.array([-north, east]) / distance**2
    return expected, full[:, list(support)]
