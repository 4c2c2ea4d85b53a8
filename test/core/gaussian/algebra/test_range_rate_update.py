"""The update of Gaussians with range rates, against sums over a dense set of states."""

from dataclasses import replace

import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.gaussian.algebra import kalman, range_rate
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel, Rates

RADAR = lone(
    {
        "radar.range_std": 0.4,
        "radar.azimuth_std_deg": 1.0,
        "radar.position": [3.0, -2.0],
        "radar.fields.range_rate": "range_rate",
        "radar.range_rate_std": 0.15,
    }
).model.radars[0]
MEAN = np.array([40.0, -12.0, 55.0, 6.0, 0.0])
STD = np.array([2.0, 5.0, 2.0, 5.0, 1e-3])
AXES = [0, 1, 2, 3]


def prior(turned=0.4):
    """Return a mean and a covariance whose axes are correlated."""
    turn = np.eye(5)
    cos, sin = np.cos(turned), np.sin(turned)
    turn[np.ix_([0, 1], [0, 1])] = turn[np.ix_([2, 3], [2, 3])] = [[cos, sin], [-sin, cos]]
    root = turn * STD
    return MEAN[None], (root @ root.T)[None]


def states(mean, covariance):
    rng = np.random.default_rng(0)
    root = np.linalg.cholesky(covariance[0, :5, :5])
    return mean + rng.standard_normal((300_000, 5)) @ root.T


def dense(radar, mean, covariance, measured, rate, time_s=0.0):
    """Return evidence, mean and covariance of the posterior by weighting states of the prior."""
    state = states(mean, covariance)
    then = state.copy()
    then[:, [0, 2]] += time_s * then[:, [1, 3]]
    error = measured - radar.measure(then)
    error[:, 1] = wrap_angle(error[:, 1])
    log_weight = -0.5 * ((error / radar.noise_std) ** 2).sum(axis=1)
    log_weight -= np.log(2.0 * np.pi * radar.noise_std.prod())
    line = then[:, [0, 2]] - radar.position
    speed = ((then[:, [1, 3]] - radar.velocity) * line).sum(axis=1) / np.hypot(*line.T)
    model = radar.range_rate
    folds = np.arange(-5, 6)[:, None] * model.ambiguity if model.ambiguity else np.zeros((1, 1))
    square = ((rate + folds - speed) / model.std) ** 2
    weight = np.exp(log_weight) * np.exp(-0.5 * square).sum(axis=0)
    weight /= np.sqrt(2.0 * np.pi) * model.std
    share = weight / weight.sum()
    assert 1.0 / (share**2).sum() > 300.0  # States that count
    centre = share @ state
    apart = state - centre
    return np.log(weight.mean()), centre, (apart * share[:, None]).T @ apart


def updated(radar, mean, covariance, measured, rate, time_s=None):
    noise = radar.noise_std[None]
    times = None if time_s is None else np.array([time_s])
    seen = Measured(measured[None], noise, None, times)
    found = kalman.innovations(WeightedGaussians.of(mean, covariance), radar, seen)
    mean, covariance = kalman.update(mean, covariance, radar, found, times)
    rates = Rates(radar.range_rate, np.array([rate]), np.array([radar.range_rate.std]))
    rated = range_rate.update_rates(mean, covariance, radar, rates, times)
    log_evidence = found.log_likelihood[0] + rated.log_likelihood[0]
    return log_evidence, rated.mean[0], rated.covariance[0]


@pytest.mark.parametrize(
    ("time_s", "velocity"), [(None, (0.0, 0.0)), (0.2, (0.0, 0.0)), (None, (15.0, -8.0))]
)
def test_update_is_the_posterior_of_a_dense_set_of_states(time_s, velocity):
    radar = replace(RADAR, velocity=velocity)
    mean, covariance = prior()
    truth = mean + np.array([1.5, 4.0, -1.0, -3.0, 0.0])
    then = truth.copy()
    then[:, [0, 2]] += (time_s or 0.0) * then[:, [1, 3]]
    measured = radar.measure(then)[0] + [0.3, 0.01]
    rate = radar.range_rate_of(then)[0] + 0.1
    found = updated(radar, mean, covariance, measured, rate, time_s)
    right = dense(radar, mean, covariance, measured, rate, time_s or 0.0)

    assert found[0] == pytest.approx(right[0], abs=0.06)
    scale = np.sqrt(np.diag(right[2]))[AXES]
    np.testing.assert_allclose((found[1] - right[1])[AXES] / scale, 0.0, atol=0.12)
    ratio = np.sqrt(np.diag(found[2]))[AXES] / scale
    np.testing.assert_allclose(ratio, 1.0, atol=0.08)
    toward = right[1][[0, 2]] - radar.position
    toward /= np.hypot(*toward)
    approximate, exact, before = (
        toward @ matrix[np.ix_([1, 3], [1, 3])] @ toward
        for matrix in (found[2], right[2], covariance[0])
    )
    assert approximate == pytest.approx(exact, rel=0.15)
    assert exact < 0.02 * before


def test_update_over_several_folds_has_the_moments_of_their_mixture():
    # The velocity is known to 5 m/s, and the interval is 8 m/s.
    radar = replace(RADAR, range_rate=RangeRateModel(0.15, 8.0))
    mean, covariance = prior()
    measured, rate = radar.measure(mean)[0], radar.range_rate_of(mean)[0] + 3.0 + 16.0
    found = updated(radar, mean, covariance, measured, rate)
    right = dense(radar, mean, covariance, measured, rate)

    assert found[0] == pytest.approx(right[0], abs=0.06)
    scale = np.sqrt(np.diag(right[2]))[AXES]
    np.testing.assert_allclose((found[1] - right[1])[AXES] / scale, 0.0, atol=0.12)
    np.testing.assert_allclose(np.sqrt(np.diag(found[2]))[AXES] / scale, 1.0, atol=0.08)


def test_update_takes_the_fold_that_is_nearest_to_what_is_expected():
    radar = replace(RADAR, range_rate=RangeRateModel(0.15, 60.0))
    mean, covariance = prior()
    measured, rate = radar.measure(mean)[0], radar.range_rate_of(mean)[0] + 1.0
    whole = updated(radar, mean, covariance, measured, rate)
    folded = updated(radar, mean, covariance, measured, rate - 120.0)
    for one, other in zip(whole, folded, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_unknown_range_rates_change_nothing():
    mean, covariance = prior()
    rates = Rates(RADAR.range_rate, np.array([np.nan]), np.array([0.15]))
    rated = range_rate.update_rates(mean, covariance, RADAR, rates)
    np.testing.assert_array_equal(rated.mean, mean)
    np.testing.assert_allclose(rated.covariance, covariance, rtol=1e-14)
    assert rated.log_likelihood == 0.0
