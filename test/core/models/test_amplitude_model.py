import numpy as np
import pytest
from scenes import small
from scipy.integrate import quad

from phd_jdtc_ros.core.models.amplitude_model import CELLS, Band, Ignored, Memory
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

MODEL = small().model
MODES, RADAR = MODEL.modes, MODEL.radars[0]
BANDS = np.log1p([c.snr_band for c in MODES.classes])


def test_ignored_amplitudes_are_left_out():
    report = Detections(np.ones((2, 2)), np.array([5.0, 9.0]))
    assert Ignored().select(report).amplitude is None
    assert Band().select(report) is report


def test_memory_likelihood_integrates_to_its_detection_probability():
    mode, log_snr, model = np.array([0]), np.array([[np.log1p(30.0)]]), Memory(0.1)

    def density(a):
        report = View.of(RADAR, Detections(np.ones((1, 2)), np.array([a])))
        return float(np.exp(model.log_cell_likelihood(log_snr, report, MODES)).item())

    mass, _ = quad(density, RADAR.threshold, 200.0)
    (expected,) = model.detection_probability(mode, log_snr[0], RADAR.threshold, MODES)
    assert mass == pytest.approx(expected, rel=1e-6)


def test_memory_averaged_over_the_band_is_the_band_likelihood():
    # The band's closed form is the Rayleigh law averaged over ln(1 + d).
    log_snr = np.linspace(*BANDS.T, 20001, axis=1)
    report = View.of(RADAR, Detections(np.ones((3, 2)), np.array([4.0, 20.0, 60.0])))
    averaged = np.exp(Memory(0.1).log_cell_likelihood(log_snr, report, MODES)).mean(axis=1)
    band = np.exp(Band().log_cell_likelihood(log_snr, report, MODES))[:, 0]
    np.testing.assert_allclose(averaged, band, rtol=1e-3)


@pytest.mark.parametrize("model", [Band(), Memory(0.1)])
def test_likelihood_without_amplitudes_is_the_detection_probability(model):
    mode, log_snr = np.array([0, 2]), model.cells(MODES).log_snr[:, :1]
    report = View.of(RADAR, Detections(np.ones((2, 2)), None))
    likelihood = np.exp(model.log_cell_likelihood(log_snr, report, MODES))
    expected = model.detection_probability(mode, log_snr[:, 0], RADAR.threshold, MODES)
    np.testing.assert_allclose(*np.broadcast_arrays(likelihood, expected[:, None, None]))


@pytest.mark.parametrize("model", [Band(), Ignored()])
def test_models_without_memory_have_one_cell_a_class_that_is_never_left(model):
    cells = model.cells(MODES)
    assert cells.log_snr.shape == (2, 1)
    assert cells.transition(MODES.interval_s) is None


def test_memory_cells_are_equal_parts_with_a_diffusion_by_interval():
    cells = Memory(0.1).cells(MODES)
    assert cells.log_snr.shape == (len(BANDS), CELLS)
    for centre, (low, high) in zip(cells.log_snr, BANDS, strict=True):
        np.testing.assert_allclose(np.diff(centre), (high - low) / CELLS)
        assert centre.mean() == pytest.approx((low + high) / 2.0)
    cells = Memory(0.3).cells(MODES)
    np.testing.assert_allclose(
        cells.transition(12.0), cells.transition(6.0) @ cells.transition(6.0), atol=1e-12
    )


@pytest.mark.parametrize("intervals", [0.01, 1.0, 3.0, 7.5])
def test_diffusion_over_the_cells_has_the_variance_of_the_jitter(intervals):
    jitter = 0.05
    cells = Memory(jitter).cells(MODES)
    matrices = cells.transition(intervals * MODES.interval_s)
    for log_snr, matrix in zip(cells.log_snr, matrices, strict=True):
        # The row is that of the middle cell, so that the edges of the band are far.
        row, away = matrix[CELLS // 2], log_snr - log_snr[CELLS // 2]
        assert row @ away == pytest.approx(0.0, abs=1e-9)
        assert row @ away**2 == pytest.approx(intervals * jitter**2, rel=1e-6)


@pytest.mark.parametrize("dt", [1e-3, 6.0, 900.0, 1e6])
def test_diffusion_over_the_cells_is_a_stochastic_matrix_of_each_class(dt):
    matrix = Memory(0.3).cells(MODES).transition(dt)
    assert (matrix >= 0.0).all()
    np.testing.assert_allclose(matrix.sum(axis=2), 1.0, rtol=1e-12)
