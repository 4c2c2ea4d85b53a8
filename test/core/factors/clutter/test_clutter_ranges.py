"""The law of false detections over range."""

import lone
import numpy as np
import pytest
from scipy.integrate import trapezoid

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.factors import ClutterRanges
from phd_jdtc_ros.core.factors.clutter.ranges import NODES, _precision
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import FULL_TURN, Detections

LIMITS = 500.0, 20e3
GIVEN = [0.0, 5e3, 20e3], [5.0, 2.0, 0.1]
UNIFORM = (), ()
# Ranges of the nodes, and points at which densities are integrated.
PLACES = LIMITS[0] + (LIMITS[1] - LIMITS[0]) * (np.arange(NODES) / (NODES - 1)) ** 2
POINTS = np.linspace(*LIMITS, 100_001)


def after(law, distance):
    return law.after(np.asarray(distance), np.ones(len(distance)))


def exponential(rng, count, mean=3e3):
    """Draw ranges of an exponential density within the limits, by its inverse distribution."""
    low, high = (-np.expm1(-limit / mean) for limit in LIMITS)
    return -mean * np.log1p(-rng.uniform(low, high, count))


@pytest.mark.parametrize("table", [GIVEN, UNIFORM])
def test_the_density_integrates_to_one_whatever_was_learned(table):
    law = ClutterRanges.of_table(True, LIMITS, table)
    for found in (law, after(law, exponential(np.random.default_rng(1), 150))):
        ratio = np.exp(found.log_ratio(POINTS))
        assert trapezoid(ratio, POINTS) == pytest.approx(LIMITS[1] - LIMITS[0], rel=2e-3)


@pytest.mark.parametrize("table", [GIVEN, UNIFORM])
def test_both_laws_are_weighed_by_their_marginal_likelihoods(table):
    """That of the learned law is the mean likelihood of laws that are drawn from its prior."""
    law, rng = ClutterRanges.of_table(True, LIMITS, table), np.random.default_rng(4)
    found = after(law, rng.uniform(*LIMITS, 10))
    coarse = np.linspace(*LIMITS, 2_000)
    hats = np.array([np.interp(coarse, PLACES, row) for row in np.eye(NODES)])
    given = np.exp(law.log_ratio(coarse))
    # The covariance of changes from node to node is that of bends and of the mean change.
    drawn = rng.multivariate_normal(np.zeros(NODES), np.linalg.inv(_precision()), 20_000)
    mean = (np.exp(drawn @ hats) * given).mean(axis=1) / given.mean()
    log_likelihood = drawn @ found.count - found.count.sum() * np.log(mean)
    probability = found._learned[0]
    expected = np.log(np.exp(log_likelihood).mean())
    assert np.log((1.0 - probability) / probability) == pytest.approx(expected, abs=0.2)


def test_few_detections_show_a_smooth_law():
    """Nodes without detections follow those beside them."""
    rng, probe = np.random.default_rng(11), np.linspace(8e3, 19e3, 50)
    error = []
    for _ in range(20):
        law = after(ClutterRanges.of_table(True, LIMITS, UNIFORM), exponential(rng, 40))
        true = (LIMITS[1] - LIMITS[0]) / 3e3 * np.exp(-(probe - LIMITS[0]) / 3e3)
        error.append(law.log_ratio(probe) - np.log(true))
    assert abs(np.mean(error)) < 0.2
    assert np.std(error) < 0.8


def test_clutter_of_the_sea_is_known_after_two_looks():
    rng = np.random.default_rng(7)
    law = ClutterRanges.of_table(True, LIMITS, UNIFORM)
    for _ in range(2):
        law = after(law, exponential(rng, 80))
    probe = exponential(rng, 20_000)
    true = (LIMITS[1] - LIMITS[0]) / 3e3 * np.exp(-(probe - LIMITS[0]) / 3e3)
    divergence = np.mean(np.log(true) - law.log_ratio(probe))
    # A uniform law is 0.9 nats off.
    assert np.mean(np.log(true)) > 0.8
    assert divergence < 0.1


@pytest.mark.parametrize("table", [GIVEN, UNIFORM])
def test_a_law_that_is_right_is_kept(table):
    rng, law = np.random.default_rng(8), ClutterRanges.of_table(True, LIMITS, table)
    fine = np.interp(POINTS, *table) if table[0] else np.ones(len(POINTS))
    for _ in range(20):
        drawn = np.interp(rng.uniform(0.0, fine.sum(), 40), np.cumsum(fine), POINTS)
        law = after(law, drawn)
    assert law.table is None
    configured = ClutterRanges.of_table(True, LIMITS, table)
    np.testing.assert_allclose(law.log_ratio(POINTS), configured.log_ratio(POINTS), atol=0.02)


def radar_with(**given):
    usual = {"position": [0.0, 0.0], "min_range": LIMITS[0], "max_range": LIMITS[1]}
    usual |= {"clutter_max_range": LIMITS[1], "clutter_rate": 40.0, "learn": []}
    config = lone.lone({f"radar.{name}": value for name, value in {**usual, **given}.items()})
    (radar,) = config.model.radars
    return radar, config.model.factors["radar"]


def test_a_table_spreads_the_configured_number():
    table = {"clutter_density_range": GIVEN[0], "clutter_density": GIVEN[1]}
    radar, factors = radar_with(**table)
    measured = np.column_stack([POINTS, np.zeros(len(POINTS))])
    view = View.of(radar, Detections(measured, None))
    for factor in factors:
        view = factor.expect(view)
    log_intensity = view.log_clutter
    total = trapezoid(np.exp(log_intensity), POINTS) * FULL_TURN
    # The number counts those nearer than the smallest range, too.
    assert total == pytest.approx(40.0 * (1.0 - LIMITS[0] / LIMITS[1]), rel=1e-3)
    expected = np.log(np.interp(1e4, *GIVEN) / np.interp(2e3, *GIVEN))
    near, far = np.interp([2e3, 1e4], POINTS, log_intensity)
    assert far - near == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("ranges", "density", "fault"),
    [
        ([0.0, 1e4], [1.0], "must be a range for each of 1 densities"),
        ([1e4, 0.0], [1.0, 2.0], "must be ascending"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(ranges, density, fault):
    with pytest.raises(ConfigError, match=fault):
        radar_with(clutter_density_range=ranges, clutter_density=density)
