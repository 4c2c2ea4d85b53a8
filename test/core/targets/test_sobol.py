import sys
from subprocess import run

import numpy as np
import pytest

from phd_jdtc_ros.core.targets.sobol import BITS, sobol_points


@pytest.mark.parametrize("dimension", range(1, 8))
@pytest.mark.parametrize("log_count", [0, 1, 5, 13])
def test_sobol_points_have_one_in_every_interval_of_each_axis(dimension, log_count):
    count = 2**log_count
    points = sobol_points(dimension, count)
    assert points.shape == (count, dimension)
    np.testing.assert_array_equal(
        np.sort(points, axis=0), np.tile(np.arange(count) / count, (dimension, 1)).T
    )


@pytest.mark.parametrize("count", [12, 0, 2 ** (BITS + 1)])
def test_sobol_points_refuse_a_count_that_is_no_power_of_two(count):
    with pytest.raises(ValueError, match=f"count: {count} given, must be"):
        sobol_points(2, count)


def test_sobol_points_are_kept_and_cannot_be_changed():
    points = sobol_points(3, 64)
    assert sobol_points(3, 64) is points
    with pytest.raises(ValueError, match="read-only"):
        points[0] = np.nan


def test_tracker_of_gaussians_starts_without_the_module_of_sobol_points():
    code = (
        "import sys; from phd_jdtc_ros.configuration import build, engines;"
        "engines.new_engine(build.resolve({'engine': 'gaussian'}));"
        "sys.exit('scipy.stats' in sys.modules)"
    )
    assert run([sys.executable, "-c", code], check=False).returncode == 0
