"""Moments of Gaussians that turn at an uncertain rate, against states that are drawn."""

import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.algebra.curvature import move, new_moved
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn

MOTIONS = (ConstantVelocity(1.0), CoordinatedTurn(1.0, 1e-4))
MEAN = np.array([4e3, 60.0, -2e3, 20.0, 0.02])
ROOT = np.diag([300.0, 12.0, 250.0, 9.0, 0.0])
ROOT[4] = [0.01, 0.03, -0.01, 0.02, 0.05]
COVARIANCE = ROOT @ ROOT.T
DT = 6.0


def moved_by(covariance, motion):
    """Return the mean, the covariance with the earlier state, and the covariance after a motion."""
    moved = new_moved()
    transition = MOTIONS[motion].jacobian(np.zeros((1, 5)), DT)[0]
    move(MEAN, covariance, transition, motion == 1, DT, moved)
    return moved.mean, moved.cross, moved.covariance


def test_moved_gaussian_has_the_moments_of_drawn_states():
    mean, cross, covariance = moved_by(COVARIANCE, 1)
    drawn = MEAN + np.random.default_rng(4).standard_normal((10**6, 5)) @ ROOT.T
    later = MOTIONS[1].mean(drawn, DT)
    std, std_later = np.sqrt(np.diag(COVARIANCE)), np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((mean - later.mean(axis=0)) / std_later, 0.0, atol=4e-3)
    exact = np.cov(later.T) / (std_later[:, None] * std_later)
    np.testing.assert_allclose(covariance / (std_later[:, None] * std_later), exact, atol=6e-3)
    between = np.cov(drawn.T, later.T)[:5, 5:] / (std[:, None] * std_later)
    np.testing.assert_allclose(cross / (std[:, None] * std_later), between, atol=6e-3)
    # The linearisation at the mean differs from the drawn velocities.
    at_mean = MOTIONS[1].jacobian(MEAN[None], DT)[0]
    linear = np.diag(at_mean @ COVARIANCE @ at_mean.T)
    assert abs(linear[3] / later[:, 3].var() - 1.0) > 0.05


@pytest.mark.parametrize("motion", [0, 1])
def test_motion_of_a_known_turn_rate_is_linear(motion):
    certain = COVARIANCE.copy()
    certain[4] = certain[:, 4] = 0.0
    mean, cross, covariance = moved_by(certain, motion)
    np.testing.assert_allclose(mean, MOTIONS[motion].mean(MEAN[None], DT)[0], atol=1e-9)
    exact = MOTIONS[motion].jacobian(MEAN[None], DT)[0]
    np.testing.assert_allclose(cross, certain @ exact.T, atol=1e-6)
    np.testing.assert_allclose(covariance, exact @ certain @ exact.T, atol=1e-6)
