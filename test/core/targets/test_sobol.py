import sys
from subprocess import run

import numpy as np
import pytest
from scipy.stats import qmc

from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.core.targets.sobol import AXES, BITS, sobol_points

DIMENSIONS = range(1, len(AXES) + 1)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("count", [1, 2, 64, 1 << 14])
def test_sobol_points_are_those_of_scipy(dimension, count):
    expected = qmc.Sobol(dimension, scramble=False, bits=BITS).random(count)
    np.testing.assert_array_equal(sobol_points(dimension, count), expected)


@pytest.mark.parametrize("dimension", DIMENSIONS)
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


@pytest.mark.parametrize("dimension", [0, len(AXES) + 1])
def test_sobol_points_refuse_a_dimension_without_directions(dimension):
    with pytest.raises(ValueError, match=f"dimension: {dimension} given, must be from 1"):
        sobol_points(dimension, 2)


def test_engines_start_without_the_statistics_of_scipy():
    code = (
        "import sys; from phd_jdtc_ros.configuration import build, engines;"
        f"[engines.new_engine(build.resolve({{'engine': name}})) for name in {(*ENGINES,)}];"
        "sys.exit('scipy.stats' in sys.modules)"
    )
    assert run([sys.executable, "-c", code], check=False).returncode == 0
