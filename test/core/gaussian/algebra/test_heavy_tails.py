"""Innovations of detections that may be outliers, against the mixture of two Kalman updates."""

import numpy as np
import pytest
import textbook
from lone import MEAN, STD, lone

from phd_jdtc_ros.core.gaussian.algebra import heavy_tails, kalman
from phd_jdtc_ros.core.learned.outliers import Outliers

OUTLIERS = Outliers(0.1, 4.0)
(RADAR,) = lone({"radar.range_std": 150.0, "radar.azimuth_std_deg": 0.5}).model.radars
COVARIANCE = np.diag(STD**2) + 2e3 * (np.eye(5, k=1) + np.eye(5, k=-1)) * [0, 1, 0, 1, 0]
COVARIANCE = 0.5 * (COVARIANCE + COVARIANCE.T)


def found(measurement, outliers):
    """Return the log likelihood, the updated mean and covariance, and whether it is an outlier."""
    prior = MEAN[None], COVARIANCE[None]
    usual = kalman.innovations(*prior, RADAR, measurement, RADAR.noise_std, iterations=1)
    noise = np.broadcast_to(RADAR.noise_std, measurement.shape)
    mixed, outlier = heavy_tails.mix_noises(usual, outliers, noise, np.zeros(1, dtype=np.int64))
    mean, covariance = kalman.update(*prior, RADAR, mixed)
    return mixed.log_likelihood[0], mean[0], covariance[0], outlier[0]


def component(measurement, ratio):
    """Return the same with a multiple of the noise, by a Kalman filter's equations."""
    position = list(RADAR.space.position)
    expected, slope = RADAR.linearise(MEAN[position])
    jacobian = np.zeros((2, 5))
    jacobian[:, position] = slope
    total = jacobian @ COVARIANCE @ jacobian.T + np.diag((ratio * RADAR.noise_std) ** 2)
    error = measurement[0] - expected
    gain = COVARIANCE @ jacobian.T @ np.linalg.inv(total)
    log_likelihood = -0.5 * (
        error @ np.linalg.solve(total, error) + np.log(np.linalg.det(2.0 * np.pi * total))
    )
    return log_likelihood, MEAN + gain @ error, COVARIANCE - gain @ jacobian @ COVARIANCE


@pytest.mark.parametrize("sigma", [0.0, 1.0, 3.0, 8.0])
def test_moments_are_those_of_the_mixture(sigma):
    measurement = RADAR.measure(MEAN[None]) + sigma * np.array([1.0, -0.7]) * [350.0, 0.03]
    parts = component(measurement, 1.0), component(measurement, OUTLIERS.ratio)
    share = np.array([1.0 - OUTLIERS.share, OUTLIERS.share])
    weight = share * np.exp([part[0] for part in parts])
    total, weight = weight.sum(), weight / weight.sum()
    mean = sum(w * part[1] for w, part in zip(weight, parts, strict=True))
    spread = sum(
        w * (part[2] + np.outer(part[1] - mean, part[1] - mean))
        for w, part in zip(weight, parts, strict=True)
    )
    log_likelihood, later, covariance, outlier = found(measurement, OUTLIERS)
    assert outlier == pytest.approx(weight[1])
    assert log_likelihood == pytest.approx(np.log(total), abs=1e-9)
    np.testing.assert_allclose(later, mean, rtol=1e-9)
    np.testing.assert_allclose(covariance, spread, rtol=1e-7, atol=1e-7 * STD.max() ** 2)


def test_outliers_of_the_usual_noise_change_nothing():
    measurement = RADAR.measure(MEAN[None]) + np.array([[200.0, 0.01]])
    prior = textbook.Normal(MEAN, COVARIANCE)
    expected = textbook.update(prior, RADAR, measurement[0], iterations=1)
    log_likelihood, mean, covariance, outlier = found(measurement, Outliers(0.3, 1.0))
    assert outlier == pytest.approx(0.3)
    assert log_likelihood == pytest.approx(expected[1])
    np.testing.assert_allclose(mean, expected[0].mean)
    np.testing.assert_allclose(covariance, expected[0].covariance)


def test_a_gaussian_outside_its_gate_stays_impossible():
    measurement = RADAR.measure(MEAN[None])
    usual = kalman.innovations(
        *(MEAN[None], COVARIANCE[None], RADAR, measurement, RADAR.noise_std),
        pairs=(np.array([-1]), np.array([0])),
    )
    noise = np.broadcast_to(RADAR.noise_std, measurement.shape)
    mixed, outlier = heavy_tails.mix_noises(usual, OUTLIERS, noise, np.zeros(1, dtype=np.int64))
    assert mixed.log_likelihood[0] == -np.inf
    assert outlier[0] == 0.0
