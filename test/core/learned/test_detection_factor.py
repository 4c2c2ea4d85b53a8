"""Detection probabilities by place, learned from counted looks."""

import numpy as np
import pytest

from phd_jdtc_ros.core.learned.detection_factor import (
    AZIMUTHS,
    CELLS,
    LEAST_PROBABILITY,
    MEMORY,
    MOST_PROBABILITY,
    DetectionFactor,
    TrialSums,
)

MAX_RANGE = 8000.0
CONFIGURED = 0.8


def learned(rng, looks, truth, start=None):
    """Return a factor after so many looks at random cells with the true probability of each."""
    factor = DetectionFactor(MAX_RANGE) if start is None else start
    for cell in rng.integers(0, CELLS, looks):
        count = np.zeros(CELLS)
        count[cell] = 1.0
        hit = float(rng.random() < truth[cell])
        factor = factor.after(TrialSums(count, CONFIGURED * count, hit * count))
    return factor


def centres():
    """Return the (range, azimuth) of the centre of each cell."""
    cell = np.arange(CELLS)
    distance = (cell // AZIMUTHS + 0.5) * MAX_RANGE / (CELLS // AZIMUTHS)
    azimuth = (cell % AZIMUTHS + 0.5) * 2.0 * np.pi / AZIMUTHS
    return np.stack([distance, np.where(azimuth > np.pi, azimuth - 2.0 * np.pi, azimuth)], axis=1)


def test_cells_go_by_range_and_azimuth():
    assert DetectionFactor(MAX_RANGE).cell(centres()).tolist() == list(range(CELLS))
    cell = DetectionFactor(MAX_RANGE).cell(np.array([[np.inf, 0.1], [MAX_RANGE, 0.1]]))
    assert cell.tolist() == [CELLS - AZIMUTHS] * 2
    given = np.full(CELLS, CONFIGURED)
    np.testing.assert_allclose(DetectionFactor(MAX_RANGE).probability(given, centres()), given)


@pytest.mark.parametrize("truth", [0.3, 0.6, 0.9])
def test_mean_is_found_within_its_deviation(truth):
    found = [learned(np.random.default_rng(seed), 250, np.full(CELLS, truth)) for seed in range(40)]
    normal = [
        (each.mean * each.configured - truth) / (each.std * each.configured) for each in found
    ]
    assert 0.7 < np.sqrt(np.mean(np.square(normal))) < 1.3


def test_half_of_the_field_that_detects_less_is_found():
    truth = np.where(np.arange(CELLS) % AZIMUTHS < AZIMUTHS // 2, 0.9, 0.45)
    rng = np.random.default_rng(3)
    count = np.full(CELLS, 200.0)
    detected = rng.binomial(200, truth).astype(float)
    factor = DetectionFactor(MAX_RANGE).after(TrialSums(count, CONFIGURED * count, detected))
    found = factor.probability(np.full(CELLS, CONFIGURED), centres())
    np.testing.assert_allclose(found, truth, atol=0.12)


def test_probabilities_are_bounded_and_those_of_the_sensor_without_looks():
    count = np.zeros(CELLS)
    count[0] = 1000.0
    factor = DetectionFactor(MAX_RANGE).after(TrialSums(count, CONFIGURED * count, 0.4 * count))
    assert factor.by_cell[-1] == pytest.approx(factor.mean)
    looks, place = np.full(CELLS, 1e4), centres()
    given = np.full(CELLS, CONFIGURED)
    none = DetectionFactor(MAX_RANGE).after(TrialSums(looks, CONFIGURED * looks, 0.0 * looks))
    assert (none.probability(given, place) == LEAST_PROBABILITY).all()
    every = DetectionFactor(MAX_RANGE).after(TrialSums(looks, 0.1 * looks, looks))
    assert (every.probability(given, place) == MOST_PROBABILITY).all()


def test_fall_of_the_probability_is_followed_within_the_memory():
    rng = np.random.default_rng(5)
    before = learned(rng, 1000, np.full(CELLS, 0.9))
    later = learned(rng, int(2.0 * MEMORY / CONFIGURED), np.full(CELLS, 0.45), before)
    assert later.mean * CONFIGURED == pytest.approx(0.51, abs=0.06)
