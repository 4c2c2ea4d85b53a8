import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.factors.clutter import map as clutter_map
from phd_jdtc_ros.core.factors.clutter.grid import GroundGrid, PolarGrid, corners
from phd_jdtc_ros.core.factors.clutter.map import ClutterMap
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.targets.stationary import among_fixed_clutter
from phd_jdtc_ros.core.types import Detections

RATE, MAX_RANGE = 10.0, 20e3
STD = np.array([10.0, np.radians(0.2)])
PLACE = np.array([[4e3, 1.0]])
CELL = 3.0 * STD  # Extent of a cell
# Six reflectors a cell apart, 42 m, three on each side of the place.
QUAY = np.stack([np.full(6, 4e3), 1.0 + np.radians(0.6) * np.array([-6, -5, -4, 4, 5, 6])], axis=1)


def empty():
    return ClutterMap(PolarGrid.of_noise(*STD))


def world(seen):
    """Return where detections of a radar at (0, 0) are."""
    return seen[:, :1] * np.stack([np.cos(seen[:, 1]), np.sin(seen[:, 1])], axis=1)


def log_factor(places, at, rate):
    at = np.atleast_2d(at)
    return places.log_density(at, world(at), rate, MAX_RANGE)


def after(places, seen, weight, revolutions):
    return places.after(seen, world(seen), weight, revolutions)


def factor(places, at):
    return np.exp(log_factor(places, at, RATE))


def answered(revolutions, place=PLACE, places=None, rng=None):
    """Return the map after a reflector has answered in so many revolutions."""
    rng = rng or np.random.default_rng(0)
    places = places or empty()
    for _ in range(revolutions):
        seen = place + rng.standard_normal(place.shape) * STD
        places = after(places, seen, np.ones(len(place)), 1.0)
    return places


def test_an_empty_map_is_uniform():
    rng = np.random.default_rng(1)
    anywhere = np.stack([rng.uniform(0, 20e3, 50), rng.uniform(-np.pi, np.pi, 50)], axis=1)
    np.testing.assert_array_equal(log_factor(empty(), anywhere, RATE), 0.0)
    report = View.of(small().model.radars[0], Detections(anywhere, None))
    np.testing.assert_array_equal(empty().expect(report).log_clutter, report.log_clutter)


def test_a_place_that_answers_has_more_clutter_of_its_own_density():
    places = answered(20)
    assert factor(places, PLACE)[0] > 1e4
    assert factor(places, [4e3, -1.0])[0] == 1.0
    assert factor(places, [4e3 + 200.0, 1.0])[0] == 1.0
    assert factor(places, [4e3, 1.0 + np.radians(4.0)])[0] == 1.0
    # Whatever rate is configured, a cell's own rate is what was counted in it.
    places = answered(50)
    few = log_factor(places, PLACE, 0.1) + np.log(0.1)
    many = log_factor(places, PLACE, 100.0) + np.log(100.0)
    np.testing.assert_allclose(few, many, atol=1e-2)


@pytest.mark.parametrize("rate", [20.0, 2000.0])
def test_uniform_clutter_makes_no_places(rate):
    """However long it lasts, and however dense it is, its density stays what it is."""
    rng, places = np.random.default_rng(5), empty()
    for _ in range(200):
        count = rng.poisson(rate)
        seen = np.stack([rng.uniform(0, 20e3, count), rng.uniform(-3.14, 3.14, count)], axis=1)
        places = after(places, seen, np.ones(count), 1.0)
    anywhere = np.stack([rng.uniform(1e3, 19e3, 500), rng.uniform(-3.0, 3.0, 500)], axis=1)
    assert 1.0 <= np.exp(log_factor(places, anywhere, rate)).mean() < 1.5


def sea(density, revolutions, rng, places=None):
    """Return the map after some revolutions of an area of 40 by 40 cells with even clutter."""
    places = places or empty()
    for _ in range(revolutions):
        count = rng.poisson(density * 40 * 40)
        seen = PLACE + rng.uniform(-20.0, 20.0, (count, 2)) * CELL
        places = after(places, seen, np.ones(count), 1.0)
    return places


@pytest.mark.parametrize("density", [0.05, 0.2])
def test_an_area_that_clutter_fills_evenly_has_the_density_of_its_clutter(density):
    rng = np.random.default_rng(6)
    places = sea(density, 60, rng)
    within = PLACE + rng.uniform(-8.0, 8.0, (200, 2)) * CELL
    per_cell = np.exp(log_factor(places, within, RATE) + places.grid.log_share(within, MAX_RANGE))
    found = RATE * per_cell / density
    assert 0.8 < np.median(found) < 1.25
    assert np.quantile(found, 0.9) < 2.0
    # Ships there are not taken for reflectors.
    excess = places.neighbourhood_excess(within, world(within), RATE, MAX_RANGE)
    assert np.quantile(among_fixed_clutter(excess), 0.9) < 0.5


def test_land_and_a_reflector_in_the_sea_are_reflectors():
    rng = np.random.default_rng(7)
    land = sea(0.6, 60, rng)
    excess = land.neighbourhood_excess(PLACE, world(PLACE), RATE, MAX_RANGE)
    assert among_fixed_clutter(excess)[0] > 0.9
    places = empty()
    for _ in range(60):
        places = answered(1, places=sea(0.05, 1, rng, places), rng=rng)
    beside = PLACE + np.array([[8.0, 8.0]]) * CELL
    assert factor(places, PLACE)[0] > 20.0 * factor(places, beside)[0]


def test_few_detections_make_no_place():
    once, often = answered(1), answered(20)
    assert factor(once, PLACE)[0] < 0.1 * factor(often, PLACE)[0]
    # A ship that moves leaves them, and has left the place before they do.
    passed = answered(4)
    later = passed
    for _ in range(12):
        later = after(later, np.zeros((0, 2)), np.zeros(0), 1.0)
    assert factor(passed, PLACE)[0] < 0.5 * factor(later, PLACE)[0]
    seldom = answered(4)
    for revolution in range(76):
        seen = PLACE if revolution % 20 == 19 else np.zeros((0, 2))
        seldom = after(seldom, seen, np.ones(len(seen)), 1.0)
    assert factor(seldom, PLACE)[0] < 0.05 * factor(answered(80), PLACE)[0]


def test_reflectors_nearby_make_a_place_likely_to_answer():
    quay = answered(2, QUAY)
    assert factor(quay, PLACE)[0] > 300.0
    assert factor(quay, [4e3 + 1000.0, 1.0])[0] == 1.0
    # One reflector makes no quay.
    single = answered(2, QUAY[:1])
    assert factor(single, PLACE)[0] == 1.0
    # A slow ship answers from the same place for some revolutions.
    alone, among = answered(4), answered(4, np.concatenate([PLACE, QUAY]))
    assert factor(alone, PLACE)[0] < 0.2 * factor(among, PLACE)[0]
    assert factor(answered(30), PLACE)[0] > 10.0 * factor(alone, PLACE)[0]


@pytest.mark.parametrize(("rate", "share"), [(5.0, 0.6), (20.0, 0.8)])
def test_rain_that_begins_is_not_explained_by_itself(rate, share):
    """It has most of its density after twenty revolutions; a passing target has none."""
    rng, places, extent = np.random.default_rng(4), answered(0), 15.5 * CELL
    for revolution in range(60):
        count = rng.poisson(rate) if revolution >= 40 else 0
        seen = PLACE + rng.uniform(-1.0, 1.0, (count, 2)) * extent
        places = after(places, seen, np.ones(count), 1.0)
    inside = PLACE + rng.uniform(-0.5, 0.5, (300, 2)) * extent
    uniform = RATE * np.exp(places.grid.log_share(PLACE, MAX_RANGE)[0])
    true = 1.0 + rate / 31.0**2 / uniform
    assert share * true < factor(places, inside).mean() < 1.2 * true
    passed = answered(2, PLACE + 4.0 * CELL, places=answered(0))
    assert factor(passed, PLACE)[0] == 1.0


def test_sectors_and_neighbours_count_as_parts_of_a_revolution_that_closes():
    quay = answered(30, QUAY)
    (about,) = quay.neighbourhood_excess(PLACE, world(PLACE), RATE, MAX_RANGE)
    assert about == pytest.approx(6.0 - 1.0, rel=0.05)
    places = answered(20, np.array([[4e3, np.pi]]))
    here = factor(places, [4e3, np.pi - 1e-9])
    np.testing.assert_allclose(factor(places, [4e3, -np.pi + 1e-9]), here, rtol=1e-5)
    assert here[0] > 1e4
    whole, parts = answered(1), empty()
    for sector in range(16):
        seen = PLACE if sector == 5 else np.zeros((0, 2))
        parts = after(parts, seen, np.ones(len(seen)), 1.0 / 16.0)
    assert parts.revolutions == pytest.approx(whole.revolutions, rel=0.01)
    assert parts.count.sum() == pytest.approx(1.0, rel=0.01)
    assert parts.recent_revolutions == pytest.approx(whole.recent_revolutions, rel=0.1)


def test_a_place_that_no_longer_answers_is_forgotten():
    places = answered(20)
    before = factor(places, PLACE)[0]
    for _ in range(300):
        places = after(places, np.zeros((0, 2)), np.zeros(0), 1.0)
    assert factor(places, PLACE)[0] < 0.01 * before
    for _ in range(1000):
        places = after(places, np.zeros((0, 2)), np.zeros(0), 1.0)
    assert len(places.cell) == 0
    assert places.revolutions == pytest.approx(clutter_map.MEMORY_REVOLUTIONS, rel=0.01)


def test_claimed_detections_are_not_in_the_map():
    places = after(empty(), np.repeat(PLACE, 3, axis=0), np.zeros(3), 1.0)
    assert len(places.cell) == 0


def test_the_map_is_of_bounded_size(monkeypatch):
    monkeypatch.setattr(clutter_map, "MAX_CELLS", 100)
    rng = np.random.default_rng(2)
    places = answered(20)
    for _ in range(20):
        seen = np.stack([rng.uniform(0, 20e3, 50), rng.uniform(-3.0, 3.0, 50)], axis=1)
        places = after(places, seen, np.ones(50), 1.0)
        assert len(places.cell) <= 100
        assert (np.diff(places.cell) > 0).all()
    assert factor(places, PLACE)[0] > 1e4


@pytest.mark.parametrize("std", [(1e-9, 1e-12), (1e9, 10.0)])
def test_a_map_is_possible_for_any_noise(std):
    places = ClutterMap(PolarGrid.of_noise(*std))
    seen = np.array([[0.0, -np.pi], [17e3, np.pi], [5.0, 0.0]])
    places = after(places, seen, np.ones(3), 1.0)
    for rate in (np.finfo(float).tiny, RATE):
        assert np.isfinite(log_factor(places, seen, rate)).all()


def test_squares_of_the_world_stay_where_they_are_while_the_radar_moves():
    places = ClutterMap(GroundGrid.of_noise(*STD, MAX_RANGE))
    reflector, rng = np.array([[3000.0, 4000.0]]), np.random.default_rng(3)
    for revolution in range(20):
        line = reflector - [100.0 * revolution, 0.0]
        seen = np.stack([np.hypot(*line.T), np.arctan2(*line.T[::-1])], axis=1)
        noise = 10.0 * rng.standard_normal((1, 2))
        places = places.after(seen, reflector + noise, np.ones(1), 1.0)
    seen = np.array([[4000.0, 2.0]])
    assert places.log_density(seen, reflector, RATE, MAX_RANGE)[0] > np.log(1e3)
    assert places.log_density(seen, reflector + 300.0, RATE, MAX_RANGE)[0] == 0.0


def test_squares_are_possible_and_distinguished_anywhere():
    """Their numbers are beyond what floats hold exactly."""
    grid = GroundGrid(50.0)
    for east in (-5e3, 5e3):
        column = np.array([[east, 50.0 * k] for k in range(6)])
        cell, share = corners(grid, grid.places(column, column))
        assert len(np.unique(cell[share > 0.5])) == 6
    places = ClutterMap(GroundGrid.of_noise(1e-9, 1e-12, MAX_RANGE))
    seen, far = np.array([[0.0, 0.0], [17e3, 1.0]]), np.array([[0.0, 0.0], [1e9, -1e9]])
    places = places.after(seen, far, np.ones(2), 1.0)
    assert np.isfinite(places.log_density(seen, far, RATE, MAX_RANGE)).all()
