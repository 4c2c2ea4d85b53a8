"""Detection probabilities and noise learned from looks, and their prior."""

import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.association.evidence import NoiseEvidence
from phd_jdtc_ros.core.factors.detection import (
    AZIMUTHS,
    CELLS,
    LEAST_PROBABILITY,
    MEMORY,
    MOST_PROBABILITY,
    Detection,
    OpenTrials,
)
from phd_jdtc_ros.core.factors.noise import (
    COMPONENTS,
    LEAST,
    MOST,
    Noise,
)
from phd_jdtc_ros.core.factors.prior import RatioPrior
from phd_jdtc_ros.core.factors.trials import ReportTrials, TrialSums
from phd_jdtc_ros.core.gaussian.measurement.noise import LEAST_NOISE_SHARE, LIMIT, evidence_of

PRIOR = RatioPrior(0.7, 0.05, 0.8)
MAX_RANGE = 8000.0
CONFIGURED = 0.8
FEW_CELLS = 4


@pytest.mark.parametrize("shown", [-1.5, -0.2, 0.0, 0.1, 0.4])
@pytest.mark.parametrize("precision", [1e-3, 4.0, 100.0, 5e3])
def test_posterior_is_that_of_numerical_integration(shown, precision):
    grid = np.linspace(-6.0, 6.0, 400_001)
    prior = PRIOR.right * norm.pdf(grid, scale=PRIOR.scale)
    prior += (1.0 - PRIOR.right) * norm.pdf(grid, scale=PRIOR.wide)
    weight = prior * np.exp(-0.5 * precision * (grid - shown) ** 2)
    mean = np.average(grid, weights=weight)
    variance = np.average((grid - mean) ** 2, weights=weight)
    found = PRIOR.posterior(np.array([shown]), np.array([precision]))
    np.testing.assert_allclose(np.concatenate(found), [mean, variance], rtol=1e-5, atol=1e-8)


def test_without_data_the_prior_stays():
    mean, variance = PRIOR.posterior(np.array([0.3]), np.zeros(1))
    assert mean == 0.0
    assert variance == pytest.approx(0.7 * 0.05**2 + 0.3 * 0.8**2)


def test_certain_data_are_followed_however_far():
    mean, _ = PRIOR.posterior(np.array([-5.0, 5.0]), np.full(2, 1e9))
    np.testing.assert_allclose(mean, [-5.0, 5.0], rtol=1e-6)


def learned_detection(rng, looks, truth, start=None):
    """Return a factor after so many looks at random cells with the true probability of each."""
    factor = Detection(MAX_RANGE) if start is None else start
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
    assert Detection(MAX_RANGE).cell(centres()).tolist() == list(range(CELLS))
    cell = Detection(MAX_RANGE).cell(np.array([[np.inf, 0.1], [MAX_RANGE, 0.1]]))
    assert cell.tolist() == [CELLS - AZIMUTHS] * 2
    given = np.full(CELLS, CONFIGURED)
    np.testing.assert_allclose(Detection(MAX_RANGE).probability(given, centres()), given)


def test_half_of_the_field_that_detects_less_is_found():
    truth = np.where(np.arange(CELLS) % AZIMUTHS < AZIMUTHS // 2, 0.9, 0.45)
    rng = np.random.default_rng(3)
    count = np.full(CELLS, 200.0)
    detected = rng.binomial(200, truth).astype(float)
    factor = Detection(MAX_RANGE).after(TrialSums(count, CONFIGURED * count, detected))
    found = factor.probability(np.full(CELLS, CONFIGURED), centres())
    np.testing.assert_allclose(found, truth, atol=0.12)


def test_probabilities_are_bounded_and_those_of_the_sensor_without_looks():
    count = np.zeros(CELLS)
    count[0] = 1000.0
    factor = Detection(MAX_RANGE).after(TrialSums(count, CONFIGURED * count, 0.4 * count))
    assert factor.by_cell[-1] == pytest.approx(factor.mean)
    looks, place = np.full(CELLS, 1e4), centres()
    given = np.full(CELLS, CONFIGURED)
    none = Detection(MAX_RANGE).after(TrialSums(looks, CONFIGURED * looks, 0.0 * looks))
    assert (none.probability(given, place) == LEAST_PROBABILITY).all()
    every = Detection(MAX_RANGE).after(TrialSums(looks, 0.1 * looks, looks))
    assert (every.probability(given, place) == MOST_PROBABILITY).all()


def test_fall_of_the_probability_is_followed_within_the_memory():
    rng = np.random.default_rng(5)
    before = learned_detection(rng, 1000, np.full(CELLS, 0.9))
    later = learned_detection(rng, int(2.0 * MEMORY / CONFIGURED), np.full(CELLS, 0.45), before)
    assert later.mean * CONFIGURED == pytest.approx(0.51, abs=0.06)


def each(value):
    return np.full(COMPONENTS, value)


def learned_noise(rng, count, truth, predicted=0.5, outliers=0.0, steps=50):
    """Return the factor after innovations whose configured variance is 1 in all components.

    `truth` is the true variance, and `predicted` that of the predicted measurement.
    """
    factor = Noise()
    for _ in range(steps):
        assumed = factor.variance
        weight, excess = np.zeros(COMPONENTS), np.zeros(COMPONENTS)
        for _ in range(count // steps):
            far = 100.0 if rng.random() < outliers else 1.0
            innovation = rng.normal(0.0, np.sqrt(predicted + far * truth), COMPONENTS)
            for axis in range(COMPONENTS):
                variance = predicted + assumed[axis]
                square, part = innovation[axis] ** 2 / variance, assumed[axis] / variance
                more, beyond = evidence_of(square, part)
                weight[axis] += more
                excess[axis] += beyond
        factor = factor.after(NoiseEvidence(weight, excess))
    return factor


def test_differences_are_followed_once_they_are_certain():
    few = Noise().after(NoiseEvidence(each(20.0), each(4.0)))
    many = Noise().after(NoiseEvidence(each(4000.0), each(800.0)))
    assert (few.variance < 1.07).all()
    assert (many.variance > 1.15).all()
    few = Noise().after(NoiseEvidence(each(20.0), each(60.0)))
    assert (few.of_std > 1.7).all()


def test_outliers_raise_the_noise_by_little_within_the_bounds():
    found = learned_noise(np.random.default_rng(1), 1000, 1.0, 0.05, outliers=0.05)
    assert (found.of_std < 1.3).all()
    assert evidence_of(100.0 * LIMIT, 0.8) == evidence_of(LIMIT, 0.8)
    most = Noise().after(NoiseEvidence(each(1e4), each(1e6)))
    least = Noise().after(NoiseEvidence(each(1e4), each(-1e4)))
    np.testing.assert_allclose(most.of_std, MOST, rtol=0.01)
    np.testing.assert_allclose(least.of_std, LEAST, rtol=0.01)
    evidence = NoiseEvidence(each(100.0), each(200.0))
    found = Noise(np.array([True, False, False])).after(evidence).of_std
    assert found[0] > 1.5
    assert found[1:].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("part", [np.nan, 0.9 * LEAST_NOISE_SHARE])
def test_innovations_that_do_not_show_the_sensors_noise_do_not_count(part):
    assert evidence_of(4.0, part) == (0.0, 0.0)


def trials(label, detected, *, expected=1.0, cell=0, existence=1.0):
    """Return trials for targets in one report, with the same values unless they are given."""
    label = np.asarray(label)

    def column(value):
        return np.broadcast_to(np.asarray(value, dtype=float), label.shape)

    return ReportTrials(
        label,
        np.broadcast_to(cell, label.shape),
        column(expected),
        column(detected),
        column(existence),
    )


def after_reports(steps):
    """Return the open trials after reports, and the sums of those that count."""
    found, total = OpenTrials(), np.zeros((3, FEW_CELLS))
    for step in steps:
        found, sums = found.after(step, FEW_CELLS)
        total += sums
    return found, total


def lives(rng, probability, targets, after_end):
    """Yield reports of targets that live for 1 to 30 reports and are looked for a while longer."""
    begin, length = rng.integers(0, 50, targets), rng.integers(1, 31, targets)
    for scan in range(90):
        here = np.flatnonzero((scan >= begin) & (scan < begin + length + after_end))
        alive = scan < (begin + length)[here]
        yield trials(here, alive & (rng.random(len(here)) < probability))


@pytest.mark.parametrize("probability", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("after_end", [0, 8])
def test_counted_trials_are_detections_with_the_true_probability(probability, after_end):
    _, (count, _, detected) = after_reports(
        lives(np.random.default_rng(4), probability, 3000, after_end)
    )
    std = np.sqrt(probability * (1.0 - probability) / count[0])
    assert count[0] > 1e4
    assert abs(detected[0] / count[0] - probability) < 4.0 * std


def test_misses_count_with_the_next_detection_and_the_detection_with_the_one_after_it():
    seen = [1.0, 0.0, 0.0, 1.0]
    _, sums = after_reports([trials([7], [d]) for d in seen])
    np.testing.assert_allclose(sums[:, 0], [3.0, 3.0, 1.0])
    _, sums = after_reports([trials([7], [d]) for d in [*seen, 1.0]])
    np.testing.assert_allclose(sums[:, 0], [4.0, 4.0, 2.0])


def test_shares_of_looks_follow_detection_and_existence():
    left, sums = after_reports([trials([7], [0.0]), trials([7], [0.4])])
    np.testing.assert_allclose(sums[:, 0], [0.4, 0.4, 0.0])
    np.testing.assert_allclose(left.open_share, [0.6, 1.0])
    _, sums = after_reports([trials([7], [0.0]), trials([7], [1.0], existence=0.25)])
    np.testing.assert_allclose(sums[:, 0], [0.25, 0.25, 0.0])
    _, sums = after_reports([trials([7], [0.0], cell=2, expected=0.8), trials([7], [1.0], cell=1)])
    np.testing.assert_allclose(sums, [[0, 0, 1, 0], [0, 0, 0.8, 0], [0, 0, 0, 0]])


def test_looks_wait_for_their_own_target():
    _, sums = after_reports([trials([7], [0.0]), trials([7], [1.0], expected=0.0)])
    np.testing.assert_allclose(sums[:, 0], [1.0, 1.0, 0.0])
    left, sums = after_reports([trials([3, 7], [0.0, 0.0]), trials([7], [1.0])])
    np.testing.assert_allclose(sums[0, 0], 1.0)
    assert left.label.tolist() == [3, 7]
    left, _ = after_reports([trials([3, 5, 7], [0.0, 0.0, 0.0])])
    assert left.of(np.array([3, 7])).label.tolist() == [3, 7]
    left, sums = after_reports([trials([7], [1.0]), *(trials([7], [0.0]) for _ in range(5))])
    assert not sums.any()
    assert len(left) == 6
