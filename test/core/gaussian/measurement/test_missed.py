"""Gaussians after a miss near the largest range, against states that are drawn."""

import numpy as np
import pytest
from lone import STD, lone, mixture_of

from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.amplitude import detection_probability
from phd_jdtc_ros.core.gaussian.measurement.gating import Expected
from phd_jdtc_ros.core.gaussian.measurement.missed import after_miss

CONFIG = lone(
    {"radar.detection_probability": 0.9, "radar.max_range": 20e3, "radar.clutter_max_range": 20e3}
)
(RADAR,) = CONFIG.model.radars
DYNAMICS = Dynamics(CONFIG.model)
# The position depends on the velocity.
ROOT = np.diag(STD)
ROOT[1, 0], ROOT[3, 2] = 20.0, -15.0
ROOT[4] = 0.0


def at_range(distance):
    """Return a target at a range in the direction 0.5 rad, and what is expected of it."""
    mean = np.zeros(5)
    mean[[0, 2]] = RADAR.to_world(np.array([[distance, 0.5]]))[0]
    mixture = mixture_of(DYNAMICS, [(0.9, mean, STD)])
    mixture = mixture.with_gaussians(mixture.weight, mixture.mean, (ROOT @ ROOT.T)[None, None])
    return mean, mixture, Expected.of(mixture, RADAR)


@pytest.mark.parametrize("inside", [400.0, 10.0, -250.0])
def test_gaussian_after_a_miss_at_the_largest_range_has_the_moments_of_drawn_states(inside):
    mean, mixture, expected = at_range(20e3 - inside)
    detectable = detection_probability(expected, mixture.snr, RADAR, DYNAMICS).by_class
    found, covariance = after_miss(mixture, expected, RADAR, detectable)

    drawn = mean + np.random.default_rng(6).standard_normal((10**6, 5)) @ ROOT.T
    share = 1.0 - 0.9 * (RADAR.measure(drawn)[:, 0] <= 20e3)
    exact = share @ drawn / share.sum()
    apart = drawn - exact
    spread = (apart * share[:, None]).T @ apart / share.sum()
    std = np.maximum(np.sqrt(np.diag(ROOT @ ROOT.T)), 1e-9)
    np.testing.assert_allclose((found[0, 0] - exact) / std, 0.0, atol=0.02)
    scale = std[:, None] * std
    np.testing.assert_allclose(covariance[0, 0] / scale, spread / scale, atol=0.03)


def test_gaussians_away_from_the_largest_range_do_not_change():
    for distance in (15e3, 24e3):
        _, mixture, expected = at_range(distance)
        detectable = detection_probability(expected, mixture.snr, RADAR, DYNAMICS).by_class
        assert after_miss(mixture, expected, RADAR, detectable) is None
