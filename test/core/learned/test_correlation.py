"""Correlation of misses, learned from pairs of looks."""

import numpy as np
import pytest

from phd_jdtc_ros.core.learned.correlation import MOST, Correlation, sums_of

MEAN = 0.7


def chain(rng, length, correlation, mean=MEAN):
    """Return the detections of a target in consecutive looks, 0 or 1, (N,)."""
    draws, found = rng.random(length), np.empty(length)
    found[0] = draws[0] < mean
    for look in range(1, length):
        found[look] = draws[look] < mean + correlation * (found[look - 1] - mean)
    return found


def learned(detected, expected, start=0.0):
    """Return the correlation after these looks at one target."""
    expected = np.broadcast_to(expected, detected.shape)
    sums = sums_of(detected[1:], detected[:-1], expected[1:], expected[:-1])
    return Correlation(start, learned=True).after(sums.sum(axis=0))


@pytest.mark.parametrize("true", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("expected", [MEAN, 0.35, 0.95])
def test_correlation_is_found_within_its_deviation(true, expected):
    """The configured mean may be wrong."""
    found = [
        learned(chain(np.random.default_rng(seed), 1500, true), expected) for seed in range(40)
    ]
    normal = [(each.value - true) / each.std for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 1.35
    assert abs(np.mean(normal)) < 0.5


def test_correlation_is_little_where_looks_show_none():
    found = [learned(chain(np.random.default_rng(s), 300, 0.0), MEAN).value for s in range(40)]
    assert np.mean(found) < 0.02
    assert learned(np.ones(500), MEAN).value == 0.0
    assert learned(np.ones(500), MEAN, start=0.5).value == 0.5


def test_a_probability_that_falls_with_the_range_is_no_correlation():
    mean = np.linspace(0.95, 0.3, 2000)
    found = [
        learned((np.random.default_rng(s).random(2000) < mean).astype(float), mean).value
        for s in range(20)
    ]
    assert np.mean(found) < 0.02
    flat = [
        learned((np.random.default_rng(s).random(2000) < mean).astype(float), 0.6).value
        for s in range(20)
    ]
    assert np.mean(flat) > 0.1


def test_correlation_is_never_certain_and_not_learned_where_given():
    found = Correlation(0.4, learned=False)
    sums = sums_of(np.ones(3), np.zeros(3), np.full(3, 0.5), np.full(3, 0.5))
    assert found.after(sums.sum(axis=0)).value == 0.4
    blocks = np.repeat([1.0, 0.0, 1.0, 0.0], 500)
    assert learned(blocks, 0.5).value <= MOST
