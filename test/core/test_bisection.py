import numpy as np
import pytest

from phd_jdtc_ros.core.bisection import count_below
from phd_jdtc_ros.core.compilation import Float1, Int1, compiled


@compiled
def counts(ascending: Float1, value: float) -> int:
    return count_below(ascending, value)


@compiled
def counts_of_integers(ascending: Int1, value: int) -> int:
    return count_below(ascending, value)


@pytest.mark.parametrize(("count", "kind"), [(counts, float), (counts_of_integers, np.int64)])
@pytest.mark.parametrize("size", [0, 1, 2, 7, 64])
def test_counts_are_the_places_of_numpy(count, kind, size):
    ascending = np.sort(np.random.default_rng(size).integers(0, 20, size)).astype(kind)
    for value in range(-1, 22):
        assert count(ascending, kind(value)) == np.searchsorted(ascending, value)
