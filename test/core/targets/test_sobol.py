import numpy as np
import pytest
from scipy.stats import qmc

from phd_jdtc_ros.core.targets.sobol import BITS, MOST_DIMENSIONS, sobol_points


@pytest.mark.parametrize("dimension", range(1, MOST_DIMENSIONS + 1))
@pytest.mark.parametrize("log_count", [0, 1, 5, 13])
def test_sobol_points_are_scipys_to_the_bit(dimension, log_count):
    expected = qmc.Sobol(dimension, scramble=False).random_base2(log_count)
    assert sobol_points(dimension, 2**log_count).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("dimension", "count", "named"),
    [
        (0, 8, "dimension: 0"),
        (MOST_DIMENSIONS + 1, 8, "dimension: 8"),
        (2, 12, "count: 12"),
        (2, 0, "count: 0"),
        (2, 2 ** (BITS + 1), "count: 2147483648"),
    ],
)
def test_sobol_points_refuse_what_they_cannot_be(dimension, count, named):
    with pytest.raises(ValueError, match=f"{named} given, must be"):
        sobol_points(dimension, count)


def test_sobol_points_are_kept_and_cannot_be_changed():
    points = sobol_points(3, 64)
    assert sobol_points(3, 64) is points
    with pytest.raises(ValueError, match="read-only"):
        points[0] = np.nan
