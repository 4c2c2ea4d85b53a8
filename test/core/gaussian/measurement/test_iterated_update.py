"""Pairs of Gaussians and detections: each is what one Gaussian alone is with one detection."""

from dataclasses import replace

import numpy as np
import pytest
from lone import MEAN, STD, TWO_MOTIONS, lone, mixture_of
from scipy.stats import norm

from phd_jdtc_ros.core.gaussian.algebra import kalman, range_rate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.iterated_update import coarse_rates, iterated_update
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections

CONFIG = lone(
    {
        **TWO_MOTIONS,
        "radar.fields.range_rate": "range_rate",
        "radar.range_rate_std": 0.5,
        "radar.range_rate_ambiguity": 0.0,
    }
)
(RADAR,) = CONFIG.model.radars
# Hypotheses and detections, some of them in several pairs.
ROW, COLUMN = np.array([0, 2, 1, 2, 0]), np.array([1, 0, 2, 2, 0])


def mixture():
    """Return three hypotheses whose modes are apart, with places and velocities correlated."""
    rng = np.random.default_rng(0)
    alike = mixture_of(Dynamics(CONFIG.model), [(0.5, MEAN, STD)] * 3)
    mean = alike.mean + rng.normal(0.0, [300.0, 20.0, 300.0, 20.0, 0.0], alike.mean.shape)
    turn = np.eye(5) + 2.0 * np.eye(5, k=1) * [0.0, 1.0, 0.0, 1.0, 0.0]
    size = rng.uniform(0.5, 1.5, (*mean.shape[:2], 1, 1))
    return alike.changed(mean=mean, covariance=size * (turn @ alike.covariance @ turn.T))


def report(times=None):
    """Return three detections near the hypotheses, with noise and range rates of their own."""
    apart = np.array([[100.0, 0.01], [-250.0, -0.02], [0.0, 0.03]])
    place = RADAR.measure(MEAN[None]) + apart
    return Detections(
        place,
        None,
        time_s=times,
        noise_std=[[50.0, 0.03], [np.nan, np.nan], [200.0, 0.002]],
        range_rate=np.array([10.0, np.nan, -30.0]),
        range_rate_std=[np.nan, 1.0, 2.0],
    )


@pytest.mark.parametrize("rated", [False, True], ids=["places", "range rates too"])
@pytest.mark.parametrize("times", [None, [0.9, -2.0, 4.0]], ids=["at the stamp", "with times"])
def test_pairs_are_where_each_detection_puts_what_flew_straight_until_then(times, rated):
    before, seen = mixture(), report(times)
    seen = seen if rated else replace(seen, range_rate=None)
    rates = RADAR.rates_of(seen)
    found = iterated_update(before, ROW, COLUMN, Report(RADAR, seen))
    # Pairs 3 and 1, in this order, and their modes; between them a hypothesis without a detection.
    pair = np.array([3, -1, 1])
    row = np.array([ROW[3], 0, ROW[1]])
    every_mean, every = found.updated_gaussians(before, row, pair)
    np.testing.assert_array_equal(every_mean[1], before.mean[0])
    np.testing.assert_array_equal(every[1], before.covariance[0])
    mean, covariance = every_mean[[0, 2]].reshape(-1, 5), every[[0, 2]].reshape(-1, 5, 5)
    gaussian = np.array([6, 7, 2, 3])

    usual = np.where(np.isnan(seen.noise_std), RADAR.noise_std, seen.noise_std)
    for place, one in enumerate(gaussian):
        (row, mode), z = (ROW[one // 2], one % 2), COLUMN[one // 2 : one // 2 + 1]
        fly = np.eye(5)
        fly[[0, 2], [1, 3]] = 0.0 if times is None else times[z[0]]
        then = fly @ before.mean[row, mode], fly @ before.covariance[row, mode] @ fly.T
        then = then[0][None], then[1][None]
        alone = kalman.innovations(*then, RADAR, seen.measurement[z], usual[z])
        log_likelihood = alone.log_likelihood[0]
        then = kalman.update(*then, RADAR, alone)
        if rated:
            told = range_rate.update_rates(*then, RADAR, rates.take(z))
            log_likelihood += told.log_likelihood[0]
            then = told.mean, told.covariance
        back = np.linalg.inv(fly)
        np.testing.assert_allclose(found.log_likelihood[one], log_likelihood, rtol=1e-9)
        np.testing.assert_allclose(mean[place], back @ then[0][0], rtol=1e-9)
        expected = back @ then[1][0] @ back.T
        std = np.sqrt(np.maximum(np.diag(expected), 1e-20))
        np.testing.assert_allclose(
            covariance[place] / np.outer(std, std), expected / np.outer(std, std), atol=1e-7
        )


def test_coarse_rates_are_the_densities_at_what_is_expected_of_each_gaussian():
    before, seen = mixture(), report()
    rates = RADAR.rates_of(seen)
    found = coarse_rates(before, ROW, COLUMN, rates, RADAR)
    assert found.shape == (5, 2)
    for pair, (row, z) in enumerate(zip(ROW, COLUMN, strict=True)):
        for mode in range(2):
            (rate,), _, (variance,) = range_rate.expected_rates(
                before.mean[row, mode][None], before.covariance[row, mode][None], RADAR
            )
            std = np.sqrt(variance + [0.5, 1.0, 2.0][z] ** 2)
            density = 0.0 if z == 1 else norm.logpdf(seen.range_rate[z], rate, std)
            assert found[pair, mode] == pytest.approx(density, rel=1e-9)
