from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.gaussian.measurement.gating import GATE_SIGMA, Expected, gate_pairs
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections

RADAR = resolve({"engine": "gaussian"}).model.radars[0]
SCALE = np.array([80.0, 9.0, 120.0, 7.0, 0.002])
FAR = 15e3


def a_mixture(rng, count=80):
    """Return hypotheses all around the radar; some have one motion mode, the first is near."""
    angle = rng.uniform(-np.pi, np.pi, (count, 1))
    mean = SCALE * rng.normal(size=(count, 2, 5))
    mean[..., 0] += RADAR.position[0] + FAR * np.cos(angle)
    mean[..., 2] += RADAR.position[1] + FAR * np.sin(angle)
    mean[0, :, [0, 2]] = np.array(RADAR.position)[:, None] + 30.0
    root = rng.normal(size=(count, 2, 5, 5)) * SCALE[:, None]
    weight = rng.random((count, 2, 2))
    weight[::3, 1] = 0.0
    covariance = root @ root.swapaxes(-1, -2)
    return Mixture(np.arange(count), weight, mean, covariance, np.ones((count, 2, 1)))


def by_brute_force(mixture, expected, detections):
    """Return (H, M, R) log likelihoods of the measurement, -inf outside of gates."""
    own = RADAR.noise_std_of(detections)
    measured, covariance = expected.measured[:, None], expected.covariance[:, None]
    if detections.time_s is not None:
        rate = RADAR.measurement_rate(mixture.mean.reshape(-1, 5)).reshape(measured[:, 0].shape)
        measured = measured + rate[:, None] * detections.time_s[:, None, None]
    error = detections.measurement[:, None] - measured
    error[..., 1] = wrap_angle(error[..., 1])
    total = covariance + own[:, None, :, None] ** 2 * np.eye(2)
    square = np.einsum("hmri,hmrij,hmrj->hmr", error, np.linalg.inv(total), error)
    density = -0.5 * (square + np.log(np.linalg.det(total))) - np.log(2.0 * np.pi)
    near = (square <= GATE_SIGMA**2) & (mixture.mode_weight > 0.0)[:, None]
    return np.where(near, density, -np.inf)


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "when passed"])
@pytest.mark.parametrize("own_noise", [False, True], ids=["one noise", "each its own"])
def test_gate_pairs_finds_the_pairs_of_a_brute_force_search(timed, own_noise):
    rng = np.random.default_rng(6)
    mixture = a_mixture(rng)
    true = mixture.mean[:, 0] + SCALE * rng.normal(size=(len(mixture), 5))
    true[0] = mixture.mean[0, 0]
    measurement = RADAR.measure(np.concatenate([true, true[::-1]]))
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    detections = Detections(measurement, None)
    if own_noise:
        std = RADAR.noise_std * rng.uniform(0.5, 2.0, measurement.shape)
        detections = replace(detections, noise_std=std)
    if timed:
        detections = replace(detections, time_s=rng.uniform(-2.0, 2.0, len(measurement)))
    expected = Expected.of(mixture, RADAR)
    row, column, log_likelihood = gate_pairs(mixture, expected, Report(RADAR, detections))
    right = by_brute_force(mixture, expected, detections)
    found = np.full_like(right, -np.inf)
    found[row, column] = log_likelihood
    assert len(row) == len(np.unique(row * len(measurement) + column)) > len(mixture)
    np.testing.assert_allclose(found[1:], right[1:], rtol=1e-9)
    # A Gaussian that surrounds the radar may be seen at any azimuth.
    inside = np.isfinite(right[0])
    np.testing.assert_allclose(found[0][inside], right[0][inside], rtol=1e-9)
    near = measurement[:, 0] < GATE_SIGMA * RADAR.range_std / 2.0
    assert near.any()
    assert np.isfinite(found[0][near][:, mixture.mode_weight[0] > 0.0]).all()


def test_gate_pairs_of_no_detections_is_empty():
    mixture = a_mixture(np.random.default_rng(0))
    expected = Expected.of(mixture, RADAR)
    none = Detections(np.zeros((0, 2)), None)
    row, column, log_likelihood = gate_pairs(mixture, expected, Report(RADAR, none))
    assert len(row) == len(column) == 0
    assert log_likelihood.shape == (0, 2)
