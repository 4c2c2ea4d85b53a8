"""Innovations of detections that may be outliers, against the mixture of two Kalman updates."""

import lone
import numpy as np
import pytest
import textbook
from lone import SIZE, STD
from mast import mast

from phd_jdtc_ros.core.factors.outliers import Outliers
from phd_jdtc_ros.core.gaussian.algebra import heavy_tails, kalman
from phd_jdtc_ros.core.sensors.gaussians import noise_covariance
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.types import Detections

OUTLIERS = Outliers(0.1, 4.0)
(RADAR,) = lone.lone({"radar.range_std": 150.0, "radar.azimuth_std_deg": 0.5}).model.radars
COVARIANCE = np.diag(STD**2) + 2e3 * (np.eye(5, k=1) + np.eye(5, k=-1)) * [0, 1, 0, 1, 0]
MEAN, COVARIANCE = lone.MEAN, 0.5 * (COVARIANCE + COVARIANCE.T)


# A sensor, and the correlation of the errors of its measurements.
SENSORS = {"radar": (RADAR, None), "positions": (mast(200.0), 0.6)}


def detection(name, sigma):
    """Return a sensor, and its detection some deviations from the expected measurement."""
    sensor, correlation = SENSORS[name]
    error = sigma * np.array([1.0, -0.7]) * sensor.noise_std
    correlation = None if correlation is None else np.array([correlation])
    return sensor, Detections(
        sensor.measure(MEAN[None]) + error, None, noise_correlation=correlation
    )


def found(sensor, seen, outliers):
    """Return the log likelihood, the updated mean and covariance, and whether it is an outlier."""
    prior, noise = (MEAN[None], COVARIANCE[None]), sensor.noise_std_of(seen)
    measured = Measured(seen.measurement, sensor.noise_std[None], seen.noise_correlation)
    usual = kalman.innovations(WeightedGaussians.of(*prior), sensor, measured, iterations=1)
    columns = noise, seen.noise_correlation, np.zeros(1, dtype=np.int64)
    mixed, outlier = heavy_tails.mix_noises(usual, outliers, *columns)
    mean, covariance = kalman.update(*prior, sensor, mixed)
    return mixed.log_likelihood[0], mean[0], covariance[0], outlier[0]


def component(sensor, seen, ratio):
    """Return the same with a multiple of the noise, by a Kalman filter's equations."""
    position = list(sensor.space.position)
    expected, slope = sensor.linearise(MEAN[position])
    jacobian = np.zeros((2, SIZE))
    jacobian[:, position] = slope
    noise = ratio**2 * noise_covariance(sensor.noise_std_of(seen), seen.noise_correlation)[0]
    total = jacobian @ COVARIANCE @ jacobian.T + noise
    error = seen.measurement[0] - expected
    gain = COVARIANCE @ jacobian.T @ np.linalg.inv(total)
    log_likelihood = -0.5 * (
        error @ np.linalg.solve(total, error) + np.log(np.linalg.det(2.0 * np.pi * total))
    )
    return log_likelihood, MEAN + gain @ error, COVARIANCE - gain @ jacobian @ COVARIANCE


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("sigma", [0.0, 2.0, 7.0, 20.0])
def test_moments_are_those_of_the_mixture(name, sigma):
    seen = detection(name, sigma)
    parts = component(*seen, 1.0), component(*seen, OUTLIERS.ratio)
    share = np.array([1.0 - OUTLIERS.share, OUTLIERS.share])
    weight = share * np.exp([part[0] for part in parts])
    total, weight = weight.sum(), weight / weight.sum()
    mean = sum(w * part[1] for w, part in zip(weight, parts, strict=True))
    spread = sum(
        w * (part[2] + np.outer(part[1] - mean, part[1] - mean))
        for w, part in zip(weight, parts, strict=True)
    )
    log_likelihood, later, covariance, outlier = found(*seen, OUTLIERS)
    assert outlier == pytest.approx(weight[1])
    assert log_likelihood == pytest.approx(np.log(total), abs=1e-9)
    np.testing.assert_allclose(later, mean, rtol=1e-9)
    np.testing.assert_allclose(covariance, spread, rtol=1e-7, atol=1e-7 * STD.max() ** 2)


def test_outliers_of_the_usual_noise_change_nothing():
    radar, seen = detection("radar", 1.3)
    prior = textbook.Normal(MEAN, COVARIANCE)
    expected = textbook.update(prior, radar, seen.measurement[0], iterations=1)
    log_likelihood, mean, covariance, outlier = found(radar, seen, Outliers(0.3, 1.0))
    assert outlier == pytest.approx(0.3)
    assert log_likelihood == pytest.approx(expected[1])
    np.testing.assert_allclose(mean, expected[0].mean)
    np.testing.assert_allclose(covariance, expected[0].covariance)


def test_a_gaussian_outside_its_gate_stays_impossible():
    radar, seen = detection("radar", 0.0)
    usual = kalman.innovations(
        WeightedGaussians.of(MEAN[None], COVARIANCE[None]),
        radar,
        Measured(seen.measurement, radar.noise_std[None]),
        pairs=(np.array([-1]), np.array([0])),
    )
    noise = radar.noise_std_of(seen), None
    mixed, outlier = heavy_tails.mix_noises(usual, OUTLIERS, *noise, np.zeros(1, dtype=np.int64))
    assert mixed.log_likelihood[0] == -np.inf
    assert outlier[0] == 0.0
