"""Gaussians after a miss at a limit of the field of view, against states that are drawn."""

import numpy as np
import pytest
from lone import STD, lone, mixture_of

from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import missed
from phd_jdtc_ros.core.gaussian.measurement.amplitude import detection_probability
from phd_jdtc_ros.core.gaussian.measurement.gating import Expected
from phd_jdtc_ros.core.gaussian.measurement.missed import after_miss

FIELD = {
    "radar.detection_probability": 0.9,
    "radar.min_range": 7e3,
    "radar.max_range": 20e3,
    "radar.clutter_max_range": 20e3,
    "radar.fov_deg": [-90.0, 80.0],
    "radar.blind_sectors_deg": [40.0, 42.0],
}
CONFIG = lone(FIELD)
(RADAR,) = CONFIG.model.radars
DYNAMICS = Dynamics(CONFIG.model)
# The position depends on the velocity.
ROOT = np.diag(STD)
ROOT[1, 0], ROOT[3, 2] = 20.0, -15.0
ROOT[4] = 0.0
LIMITS = {
    "largest range": (20e3, 0.5),
    "just within the largest range": (19_600.0, 0.5),
    "beyond the largest range": (20_250.0, 0.5),
    "least range": (7050.0, 0.5),
    "edge of the field": (12e3, np.radians(79.5)),
    "outside the field": (12e3, np.radians(-92.0)),
    "blind sector": (12e3, np.radians(40.5)),
}


def target_at(place):
    """Return a target at a range and an azimuth, and what is expected of it."""
    mean = np.zeros(5)
    mean[[0, 2]] = RADAR.to_world(np.array([place]))[0]
    mixture = mixture_of(DYNAMICS, [(0.9, mean, STD)])
    mixture = mixture.changed(covariance=(ROOT @ ROOT.T)[None, None])
    return mean, mixture, Expected.of(mixture, RADAR)


def missed_at(place):
    """Return the mean of a target, and its mean and covariance after a miss, or None."""
    mean, mixture, expected = target_at(place)
    probability = detection_probability(expected, mixture.snr, RADAR, DYNAMICS).by_class
    return mean, after_miss(mixture, expected, RADAR, probability)


@pytest.mark.parametrize("place", LIMITS.values(), ids=LIMITS)
def test_gaussian_after_a_miss_at_a_limit_has_the_moments_of_drawn_states(place):
    mean, (found, covariance) = missed_at(place)
    drawn = mean + np.random.default_rng(6).standard_normal((10**6, 5)) @ ROOT.T
    share = 1.0 - 0.9 * RADAR.visibility.probability_in_view(RADAR.measure(drawn))
    exact = share @ drawn / share.sum()
    apart = drawn - exact
    spread = (apart * share[:, None]).T @ apart / share.sum()
    std = np.maximum(np.sqrt(np.diag(ROOT @ ROOT.T)), 1e-9)
    np.testing.assert_allclose((found[0, 0] - exact) / std, 0.0, atol=0.02)
    scale = std[:, None] * std
    np.testing.assert_allclose(covariance[0, 0] / scale, spread / scale, atol=0.03)


@pytest.mark.parametrize("place", [(15e3, 0.5), (24e3, 0.5), (15e3, np.radians(-120.0))])
def test_gaussians_away_from_all_limits_do_not_change(place):
    assert missed_at(place)[1] is None


def test_gaussians_beside_the_sensor_do_not_change(monkeypatch):
    monkeypatch.setattr(missed, "LARGEST_AZIMUTH_STD", 0.01)
    assert missed_at(LIMITS["least range"])[1] is None
