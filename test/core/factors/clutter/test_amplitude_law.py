import numpy as np
import pytest

from phd_jdtc_ros.core.factors.clutter import amplitude as amplitude_law
from phd_jdtc_ros.core.factors.clutter.amplitude import CELLS, MEMORY, Learned
from phd_jdtc_ros.core.sensors.view import NOISE
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.amplitude_density import threshold_for

TAU = threshold_for(1e-3)
AMPLITUDES = np.geomspace(0.01, 3000.0, 200)


def envelope(level_db):
    """Return the envelope of which a level in dB is 10 log10(a^2 / 2)."""
    return np.sqrt(2.0 * 10.0 ** (np.asarray(level_db) / 10.0))


def taught(levels_db, law=None):
    amplitude = envelope(levels_db)
    return (law or Learned(TAU)).after(amplitude, np.ones(len(amplitude)))


LAWS = {
    "noise": NOISE,
    "untaught": Learned(TAU),
    "taught": taught(np.linspace(10.0, 20.0, 50)),
}


def test_noise_is_the_density_of_the_radars_noise_bit_by_bit():
    density = amplitude_density.log_clutter_density(AMPLITUDES)
    np.testing.assert_array_equal(NOISE.log_density(AMPLITUDES), density)
    assert NOISE.log_share(TAU) == -0.5 * TAU**2


@pytest.mark.parametrize("name", LAWS)
def test_a_law_integrates_to_one_and_knows_unknown_amplitudes(name):
    law = LAWS[name]
    # A learned law has cells from -20 to 80 dB.
    lowest = envelope(-20.0) if isinstance(law, Learned) else 1e-5
    grid = np.geomspace(lowest, envelope(80.0), 400_001)
    density = np.exp(law.log_density(grid))
    below = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(grid))])
    assert below[-1] == pytest.approx(1.0, abs=1e-3)
    for threshold in (TAU, 6.0, 10.0):
        tail = below[-1] - np.interp(threshold, grid, below)
        assert np.exp(law.log_share(threshold)) == pytest.approx(tail, abs=2e-3)
        other = law.log_share(threshold) - law.log_share(TAU)
        assert law.log_share(threshold, TAU) == pytest.approx(other, abs=1e-9)
    assert law.log_share(0.0) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(LAWS[name].log_density(np.array([np.nan, 5.0]))).tolist() == [True, False]


def test_the_learned_law_approaches_that_of_noise_or_of_its_detections():
    rng = np.random.default_rng(0)
    law = taught(rng.uniform(10.0, 20.0, 5000))
    inside = law.log_density(envelope([11.0, 15.0, 19.0]))
    uniform = np.log(0.1 * 2.0 * amplitude_law.DB_PER_NEPER / envelope([11.0, 15.0, 19.0]))
    np.testing.assert_allclose(inside, uniform, atol=0.5)
    law = Learned(TAU)
    square = TAU**2 - 2.0 * np.log((np.arange(20) + 0.5) / 20)
    for _ in range(100):
        law = law.after(np.sqrt(square), np.ones(20))
    for level in (8.6, 9.0, 9.4, 9.9, 10.9, 12.0):
        exact = np.exp(NOISE.log_share(envelope(level), TAU))
        # A tenth of the law is for any level, and its cells are half a decibel wide.
        assert np.exp(law.log_share(envelope(level), TAU)) == pytest.approx(exact, abs=0.15)


@pytest.mark.parametrize("levels_db", [[], [9.0] * 10, [9.0] * 1000, [9.0] * 100_000])
@pytest.mark.parametrize(
    ("band_db", "bound"), [((10.0, 30.0), 50.0), ((30.0, 50.0), 50.0), ((20.0, 20.1), 85.0)]
)
def test_no_amplitude_speaks_for_a_target_by_more_than_a_bound(levels_db, band_db, bound):
    """However many false detections were low, and however high the next one is."""
    law = taught(levels_db)
    band = tuple(map(amplitude_density.snr_from_db, band_db))
    amplitude = envelope(np.linspace(8.5, 79.0, 400))
    ratio = amplitude_density.log_target_density(amplitude, band) - law.log_density(amplitude)
    assert np.exp(ratio.max()) <= bound


def test_a_few_high_detections_end_the_evidence_of_height():
    """Against noise, 14 dB is evidence of e^18; that is the first three false targets of a run."""
    band = tuple(map(amplitude_density.snr_from_db, (10.0, 30.0)))
    high = envelope([14.0])
    target = amplitude_density.log_target_density(high, band)
    assert target - NOISE.log_density(high) + NOISE.log_share(TAU) > np.log(1e4)
    law = taught(np.linspace(10.0, 20.0, 12))
    assert target - law.log_density(high) < np.log(4.0)


def test_memory_is_bounded_and_taught_by_unclaimed_known_detections_alone():
    law = taught([9.0] * 5000)
    assert law.count.sum() == pytest.approx(MEMORY, rel=1e-6)
    before = law.log_density(envelope([15.0]))[0]
    law = taught([15.0] * int(3 * MEMORY), law)
    assert law.log_density(envelope([15.0]))[0] > before + 5.0
    assert law.count[: CELLS // 3].sum() < 0.06 * MEMORY
    law = Learned(TAU)
    amplitude = np.array([10.0, np.nan, 20.0, np.inf])
    assert law.after(amplitude, np.array([0.0, 1.0, 0.0, 1.0])) is law
    half = law.after(amplitude, np.array([0.5, 1.0, 0.25, 1.0]))
    assert half.count.sum() == pytest.approx(0.75, rel=2e-3)


def test_a_revolution_teaches_the_same_in_one_report_as_in_sectors():
    levels = np.random.default_rng(3).uniform(9.0, 25.0, 32)
    whole, parts = taught(levels), Learned(TAU)
    for part in np.split(levels, 16):
        parts = taught(part, parts)
    assert parts.count.sum() == pytest.approx(whole.count.sum(), rel=1e-12)
    np.testing.assert_allclose(parts.count, whole.count, rtol=0.12)


def test_amplitudes_beyond_all_cells_count_in_the_outermost():
    law = Learned(TAU).after(np.array([0.0, 1e-9, 1e12]), np.ones(3))
    assert law.count[0] == pytest.approx(2.0, rel=0.02)
    assert law.count[-1] == pytest.approx(1.0, rel=0.02)
    assert np.isfinite(law.log_density(np.array([0.0, 1e12]))).all()


@pytest.mark.parametrize("threshold", [0.0, 1e-9, 1e9])
def test_a_learned_law_has_a_density_for_any_threshold(threshold):
    law = Learned(threshold).after(np.array([5.0]), np.ones(1))
    assert np.isfinite(law.log_density(AMPLITUDES)).all()
    assert np.isfinite(law.log_share(threshold))
