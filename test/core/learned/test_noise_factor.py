"""Noise learned from innovations, whichever noise was assumed when they were made."""

import numpy as np
import pytest

from phd_jdtc_ros.core.learned.evidence import LEAST_NOISE_SHARE, LIMIT, evidence_of
from phd_jdtc_ros.core.learned.noise_factor import (
    COMPONENTS,
    LEAST,
    MOST,
    NoiseEvidence,
    NoiseFactor,
)


def each(value):
    return np.full(COMPONENTS, value)


def learned(rng, count, truth, predicted=0.5, outliers=0.0, steps=50):
    """Return the factor after innovations whose configured variance is 1 in all components.

    `truth` is the true variance, and `predicted` that of the predicted measurement.
    """
    factor = NoiseFactor()
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


@pytest.mark.parametrize("truth", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("predicted", [0.05, 1.0])
def test_noise_is_found_within_its_deviation(truth, predicted):
    found = [learned(np.random.default_rng(s), 300, truth, predicted) for s in range(16)]
    normal = [(one.of_std - np.sqrt(truth)) / one.error for one in found]
    assert np.sqrt(np.mean(np.square(normal))) < 1.6


def test_differences_are_followed_once_they_are_certain():
    few = NoiseFactor().after(NoiseEvidence(each(20.0), each(4.0)))
    many = NoiseFactor().after(NoiseEvidence(each(4000.0), each(800.0)))
    assert (few.variance < 1.07).all()
    assert (many.variance > 1.15).all()
    few = NoiseFactor().after(NoiseEvidence(each(20.0), each(60.0)))
    assert (few.of_std > 1.7).all()


def test_outliers_raise_the_noise_by_little_within_the_bounds():
    found = learned(np.random.default_rng(1), 1000, 1.0, 0.05, outliers=0.05)
    assert (found.of_std < 1.3).all()
    assert evidence_of(100.0 * LIMIT, 0.8) == evidence_of(LIMIT, 0.8)
    most = NoiseFactor().after(NoiseEvidence(each(1e4), each(1e6)))
    least = NoiseFactor().after(NoiseEvidence(each(1e4), each(-1e4)))
    np.testing.assert_allclose(most.of_std, MOST, rtol=0.01)
    np.testing.assert_allclose(least.of_std, LEAST, rtol=0.01)
    evidence = NoiseEvidence(each(100.0), each(200.0))
    found = NoiseFactor(np.array([True, False, False])).after(evidence).of_std
    assert found[0] > 1.5
    assert found[1:].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("part", [np.nan, 0.9 * LEAST_NOISE_SHARE])
def test_innovations_that_do_not_show_the_sensors_noise_do_not_count(part):
    assert evidence_of(4.0, part) == (0.0, 0.0)
