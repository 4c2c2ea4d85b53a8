"""Noise learned from innovations, whichever noise was assumed when they were made."""

import numpy as np
import pytest

from phd_jdtc_ros.core.learned.evidence import LEAST_NOISE_SHARE, LIMIT, evidence_of
from phd_jdtc_ros.core.learned.noise_factor import LEAST, MOST, NoiseEvidence, NoiseFactor


def learned(rng, count, truth, predicted=0.5, outliers=0.0, steps=50):
    """Return the factor after innovations whose configured variance is 1 in both components.

    `truth` is the true variance, and `predicted` that of the predicted measurement.
    """
    factor = NoiseFactor()
    for _ in range(steps):
        assumed = factor.variance
        weight, excess = np.zeros(2), np.zeros(2)
        for _ in range(count // steps):
            far = 100.0 if rng.random() < outliers else 1.0
            innovation = rng.normal(0.0, np.sqrt(predicted + far * truth), 2)
            for axis in range(2):
                variance = predicted + assumed[axis]
                square, part = innovation[axis] ** 2 / variance, assumed[axis] / variance
                more, beyond = evidence_of(square, part)
                weight[axis] += more
                excess[axis] += beyond
        factor = factor.after(NoiseEvidence(weight, excess))
    return factor


@pytest.mark.parametrize("truth", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("predicted", [0.05, 1.0])
def test_noise_is_found_within_its_deviation(truth, predicted):
    found = [learned(np.random.default_rng(s), 300, truth, predicted) for s in range(16)]
    normal = [(each.of_std - np.sqrt(truth)) / each.error for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 1.6


def test_small_differences_are_left_alone_until_they_are_certain():
    few = NoiseFactor().after(NoiseEvidence(np.full(2, 20.0), np.full(2, 4.0)))
    many = NoiseFactor().after(NoiseEvidence(np.full(2, 4000.0), np.full(2, 800.0)))
    assert (few.variance < 1.07).all()
    assert (many.variance > 1.15).all()


def test_large_differences_are_followed_at_once():
    few = NoiseFactor().after(NoiseEvidence(np.full(2, 20.0), np.full(2, 60.0)))
    assert (few.of_std > 1.7).all()


def test_rare_outliers_raise_the_noise_by_little():
    found = learned(np.random.default_rng(1), 1000, 1.0, 0.05, outliers=0.05)
    assert (found.of_std < 1.3).all()


def test_innovations_beyond_the_limit_count_as_those_at_it():
    assert evidence_of(100.0 * LIMIT, 0.8) == evidence_of(LIMIT, 0.8)


@pytest.mark.parametrize("part", [np.nan, 0.9 * LEAST_NOISE_SHARE])
def test_innovations_that_do_not_show_the_sensors_noise_do_not_count(part):
    assert evidence_of(4.0, part) == (0.0, 0.0)


def test_factor_stays_within_its_bounds():
    most = NoiseFactor().after(NoiseEvidence(np.full(2, 1e4), np.full(2, 1e6)))
    least = NoiseFactor().after(NoiseEvidence(np.full(2, 1e4), np.full(2, -1e4)))
    np.testing.assert_allclose(most.of_std, MOST, rtol=0.01)
    np.testing.assert_allclose(least.of_std, LEAST, rtol=0.01)


def test_only_the_learned_component_changes():
    evidence = NoiseEvidence(np.full(2, 100.0), np.full(2, 200.0))
    found = NoiseFactor(np.array([True, False])).after(evidence).of_std
    assert found[0] > 1.5
    assert found[1] == 1.0
