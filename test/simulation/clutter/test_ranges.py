import numpy as np
import pytest
from reference import resolve
from scipy.stats import kstest

from phd_jdtc_ros.core.factors.clutter.ranges import ClutterRanges
from phd_jdtc_ros.simulation.clutter import NOISE
from phd_jdtc_ros.simulation.simulate import false_detections

FAR, COUNT = 15_000.0, 20_000
# An increasing, a constant and a decreasing part, and a range beyond those of the clutter.
RANGES = [1000.0, 4000.0, 6000.0, 20_000.0]
DENSITY = [1.0, 8.0, 8.0, 0.1]


def ranges_of(near, **density):
    """Return the configured radar's law of ranges, and the ranges of its false detections."""
    given = {f"radar_1.{name}": value for name, value in density.items()}
    limits = {"radar_1.clutter_max_range": FAR, "radar_1.min_range": near}
    model = resolve({**given, **limits}).model
    radar, rng = model.radars[0], np.random.default_rng(7)
    (law,) = (each for each in model.factors["radar_1"] if isinstance(each, ClutterRanges))
    measured, _ = false_detections(radar, COUNT, rng, NOISE)
    return law, measured[:, 0]


@pytest.mark.parametrize("near", [0.0, 500.0, 2000.0])
def test_ranges_of_false_detections_have_the_density_that_the_tracker_expects(near):
    law, found = ranges_of(near, clutter_density=DENSITY, clutter_density_range=RANGES)
    points = np.linspace(near, FAR, 20_001)
    density = np.exp(law.log_ratio(points))
    integral = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(points)))

    def distribution(distance):
        return np.interp(distance, points, integral / integral[-1])

    assert kstest(found[found > near], distribution).pvalue > 0.01
    # As many as of uniform clutter are below the smallest range, where they are dropped.
    below = np.count_nonzero(found < near)
    assert abs(below - COUNT * near / FAR) <= 4.0 * np.sqrt(COUNT * near / FAR)


def test_a_constant_density_leaves_uniform_ranges_as_they_are():
    _, found = ranges_of(500.0, clutter_density=[3.0, 3.0], clutter_density_range=[0.0, 9000.0])
    uniform = np.random.default_rng(7).uniform(0.0, FAR, COUNT)
    np.testing.assert_allclose(found, uniform, rtol=1e-9)
