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


def every_pair(log_snr, detections):
    row, column = np.indices((len(log_snr), len(detections))).reshape(2, -1)
    return row, column


def test_band_and_ignored_amplitudes_remember_nothing():
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    mode = np.array([0, 3])
    assert Band().draw(mode, MODES, rng).tolist() == [0.0, 0.0]
    assert rng.bit_generator.state == before
    report = Detections(np.ones((2, 2)), np.array([5.0, 9.0]))
    assert Ignored().select(report).amplitude is None
    assert Band().select(report) is report


def test_memory_is_born_uniform_in_the_band_of_its_class():
    mode = np.repeat([0, 2], 4000)
    born = Memory(0.1).draw(mode, MODES, np.random.default_rng(0))
    for class_id, part in enumerate((born[:4000], born[4000:])):
        low, high = BANDS[class_id]
        assert part.min() >= low
        assert part.max() <= high
        # The standard error of a uniform mean over 4000 draws is 0.46 % of the width.
        assert part.mean() == pytest.approx((low + high) / 2.0, abs=0.02 * (high - low))


def test_memory_moves_by_its_jitter_and_the_interval():
    memory = np.linspace(*BANDS[0], 5000)
    mode, rng = np.zeros(5000, dtype=int), np.random.default_rng(0)
    moved = Memory(0.1).diffuse(memory, mode, MODES, MODES.interval_s, rng)
    assert moved.min() >= BANDS[0, 0]
    assert moved.max() <= BANDS[0, 1]
    assert np.std(moved - memory) == pytest.approx(0.1, rel=0.05)
    memory = np.full(5000, BANDS[0].mean())
    mode = np.zeros(5000, dtype=int)
    short, long = (
        Memory(0.1).diffuse(memory, mode, MODES, dt, np.random.default_rng(0)) - memory
        for dt in (MODES.interval_s, 4.0 * MODES.interval_s)
    )
    np.testing.assert_allclose(long, 2.0 * short)


@pytest.mark.parametrize("amplitude", [0.0, 3.0, 40.0, 200.0, 1e4])
@pytest.mark.parametrize("mode", [0, 2])
def test_memory_born_of_a_detection_follows_its_amplitude(mode, amplitude):
    count = 20_000
    born = Memory(0.1).draw(
        np.full(count, mode), MODES, np.random.default_rng(0), np.full(count, amplitude)
    )
    low, high = BANDS[MODES.class_of[mode]]
    edges = np.linspace(low, high, 2001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    # The flat prior times the Rayleigh density of the amplitude.
    log_density = -middle - 0.5 * max(amplitude, 1e-6) ** 2 * np.exp(-middle)
    share = np.exp(log_density - log_density.max())
    share /= share.sum()
    mean = share @ middle
    error = np.sqrt(share @ (middle - mean) ** 2 / count)
    assert born.min() >= low
    assert born.max() <= high
    assert born.mean() == pytest.approx(mean, abs=4.5 * error + 1e-3 * (high - low))


def test_memory_likelihood_integrates_to_its_detection_probability():
    mode, log_snr, model = np.array([0]), np.array([np.log1p(30.0)]), Memory(0.1)

    def density(a):
        report = View.of(RADAR, Detections(np.ones((1, 2)), np.array([a])))
        pairs = every_pair(log_snr, report)
        return float(np.exp(model.log_likelihood(mode, log_snr, report, pairs, MODES))[0])

    mass, _ = quad(density, RADAR.threshold, 200.0)
    (expected,) = model.detection_probability(mode, log_snr, RADAR.threshold, MODES)
    assert mass == pytest.approx(expected, rel=1e-6)


def test_memory_averaged_over_the_band_is_the_band_likelihood():
    # The band's closed form is the Rayleigh law averaged over ln(1 + d).
    mode, log_snr = np.full(20001, 2), np.linspace(*BANDS[1], 20001)
    report = View.of(RADAR, Detections(np.ones((3, 2)), np.array([4.0, 20.0, 60.0])))
    pairs = every_pair(log_snr, report)
    remembered = np.exp(Memory(0.1).log_likelihood(mode, log_snr, report, pairs, MODES))
    averaged = remembered.reshape(len(log_snr), 3).mean(axis=0)
    band = np.exp(Band().log_likelihood(mode, log_snr, report, pairs, MODES))[:3]
    np.testing.assert_allclose(averaged, band, rtol=1e-3)


@pytest.mark.parametrize("model", [Band(), Memory(0.1)])
def test_likelihood_without_amplitudes_is_the_detection_probability(model):
    mode, log_snr = np.array([0, 0]), BANDS[0]
    report = View.of(RADAR, Detections(np.ones((2, 2)), None))
    pairs = every_pair(log_snr, report)
    likelihood = np.exp(model.log_likelihood(mode, log_snr, report, pairs, MODES))
    expected = model.detection_probability(mode, log_snr, RADAR.threshold, MODES)
    np.testing.assert_allclose(likelihood, np.repeat(expected, 2))


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
