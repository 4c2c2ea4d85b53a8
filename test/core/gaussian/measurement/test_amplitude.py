"""The probabilities of the cells of SNR after an update."""

from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.amplitude import Amplitudes, log_amplitude, snr_after
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections


@pytest.mark.parametrize("amplitude", ["memory", "band", "none"])
def test_amplitudes_are_likelihoods_relative_to_the_most_likely_cell(amplitude):
    model = resolve({"engine": "gaussian", "amplitude": amplitude}).model
    dynamics, measured = Dynamics(model), np.array([[5e3, 0.1], [7e3, -2.0], [4e3, 1.0]])
    report = Report(model.radars[0], Detections(measured, np.array([4.0, np.nan, 60.0])))
    found, expected = Amplitudes.of(report, dynamics), log_amplitude(report, dynamics)
    np.testing.assert_allclose(found.relative.max(axis=(1, 2)), 1.0)
    with np.errstate(divide="ignore"):
        log_likelihood = found.largest[:, None, None] + np.log(found.relative)
    tiny = np.exp(expected - expected.max(axis=(0, 1))) == 0.0
    expected = np.where(tiny, -np.inf, expected).transpose(2, 0, 1)
    np.testing.assert_allclose(log_likelihood, expected, rtol=1e-9)


def test_detection_probability_by_cell_is_that_of_each_threshold():
    model = resolve({"engine": "gaussian", "amplitude": "memory"}).model
    dynamics, radar = Dynamics(model), model.radars[0]
    power = np.exp(dynamics.cells.log_snr)
    for threshold in (radar.threshold, radar.threshold + 1.0, radar.threshold):
        found = dynamics.cell_probability(replace(radar, threshold=threshold))
        np.testing.assert_allclose(found, np.exp(-0.5 * threshold**2 / power), rtol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e-310])
def test_snr_after_a_detection_is_bayes_rule_however_improbable_the_class_is(scale):
    prior, likelihood = np.array([[[0.2, 0.5, 0.3]]]), np.array([[[1.0, 4.0, 2.0]]])
    one, first = np.ones((1, 1, 1)), np.zeros(1, dtype=np.int64)
    cells = np.ones((1, 3)), np.ones((1, 1))
    found = snr_after(prior, one, one, *cells, scale * likelihood, first, first, first)
    expected = prior * likelihood
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-10)
