import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.measurement.pruning import most_probable

MOST, LEAST_SHARE = 5, 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_existence_is_unchanged_by_pruning_and_bounds_hold(seed):
    rng = np.random.default_rng(seed)
    target = rng.integers(0, 6, 80)
    target[:6] = np.arange(6)
    mass = rng.exponential(1.0, 80) ** 6
    mass /= np.bincount(target, mass)[target]
    mass *= rng.uniform(0.1, 1.0, 6)[target]
    kept, factor = most_probable(MOST, LEAST_SHARE, target, mass)
    existence = np.bincount(target, mass)
    np.testing.assert_allclose(np.bincount(target[kept], mass[kept] * factor), existence)
    assert np.bincount(target[kept]).max() <= MOST
    assert (mass[kept] >= LEAST_SHARE * existence[target[kept]]).all()
    for one in range(6):
        own = kept[target[kept] == one]
        assert (np.diff(mass[own]) <= 0.0).all()
        dropped = np.setdiff1d(np.flatnonzero(target == one), own)
        assert mass[dropped].max(initial=0.0) <= mass[own].min()
