"""The picture of a map of clutter, and the probability that a target is at rest."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.factors.clutter.grid import GroundGrid, PolarGrid
from phd_jdtc_ros.core.factors.clutter.map import ClutterMap
from phd_jdtc_ros.core.factors.clutter.raster import MAX_CELLS, raster
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.targets import stationary
from phd_jdtc_ros.core.tracks.coverage import stationary_speed
from phd_jdtc_ros.core.types import Detections, Pose

STD = np.array([10.0, math.radians(0.2)])
# Off the axes, and twice as much at the second.
PLACES = np.array([[1500.0, -3200.0], [-2400.0, 1700.0], [-2400.0, 1700.0]])
TURNED = Pose((400.0, -700.0), math.radians(130.0))
POLAR = PolarGrid.of_noise(*STD)
GROUND = GroundGrid.of_noise(*STD, 10e3)
BOUND = 2.5


def radar(name="mast", pose=TURNED):
    return replace(small().model.radars[0], name=name).at(pose)


def learned(grid, seen_from, places=PLACES, revolutions=20):
    """Return the map after reflectors at places have answered, from a pose for each revolution."""
    found = ClutterMap(grid)
    for revolution in range(revolutions):
        own = seen_from[revolution % len(seen_from)]
        state = np.zeros((len(places), 5))
        state[:, [0, 2]] = places
        seen = own.measure(state)
        found = found.after(seen, own.to_world(seen), np.ones(len(seen)), 1.0)
    return found


MOVING = [radar(pose=Pose((400.0 + 30.0 * k, -700.0), 0.1 * k)) for k in range(20)]


@pytest.mark.parametrize(
    ("grid", "seen_from"),
    [(POLAR, [radar()]), (GROUND, MOVING)],
    ids=["with yaw", "moving and turning"],
)
def test_a_reflector_is_drawn_where_it_is(grid, seen_from):
    shown = raster({"mast": learned(grid, seen_from)}, [seen_from[0]])
    left, right, bottom, top = shown.extent
    assert (np.array([left, bottom]) < PLACES).all()
    assert (np.array([right, top]) > PLACES).all()
    assert max(shown.density.shape) <= MAX_CELLS
    rows, columns = np.nonzero(shown.density)
    x, y = left + (columns + 0.5) * shown.cell, bottom + (rows + 0.5) * shown.cell
    weight = shown.density[rows, columns]
    for place in np.unique(PLACES, axis=0):
        near = np.hypot(x - place[0], y - place[1]) < 100.0
        centre = np.average(np.stack([x[near], y[near]], axis=1), axis=0, weights=weight[near])
        np.testing.assert_allclose(centre, place, atol=20.0)
    # Nothing is drawn elsewhere.
    away = np.hypot(x[:, None] - PLACES[:, 0], y[:, None] - PLACES[:, 1]).min(axis=1)
    assert away.max() < 100.0


@pytest.mark.parametrize("grid", [POLAR, GROUND], ids=["polar", "ground"])
def test_densities_are_detections_per_revolution_and_area(grid):
    shown = raster({"mast": learned(grid, [radar()])}, [radar()])
    area = shown.cell**2 * 1e-6
    assert shown.density.sum() * area == pytest.approx(3.0, rel=1e-6)


def test_the_pictures_of_two_radars_are_added():
    one, other = radar("one"), radar("two", Pose((-3000.0, 2000.0), 0.4))
    maps = {"one": learned(POLAR, [one]), "two": learned(POLAR, [other])}
    shown = raster(maps, [one, other])
    assert shown.density.sum() * shown.cell**2 * 1e-6 == pytest.approx(6.0, rel=1e-6)


def test_there_is_no_picture_of_nothing():
    assert raster({}, [radar()]) is None
    assert raster({"mast": ClutterMap(POLAR)}, [radar()]) is None


def velocities(mean, std):
    return np.atleast_2d(mean).astype(float), np.eye(2)[None] * std**2


def test_slower_velocities_are_as_probable_as_drawn():
    mean, covariance = velocities([2.0, -1.0], 1.5)
    drawn = mean + 1.5 * np.random.default_rng(0).standard_normal((200_000, 2))
    share = (np.hypot(*drawn.T) < BOUND).mean()
    assert stationary.probability_slower(mean, covariance, BOUND)[0] == pytest.approx(
        share, abs=0.005
    )
    mean, covariance = velocities([[1.0, 0.0], [4.0, 0.0], [1e4, 0.0]], 1e-9)
    np.testing.assert_allclose(
        stationary.probability_slower(mean, covariance, BOUND), [1.0, 0.0, 0.0], atol=1e-9
    )
    assert stationary.probability_slower(*velocities([0.0, 0.0], 1.0), 0.0) == 0.0


@pytest.mark.parametrize("velocity_std", [1.0, 5.0, 40.0])
def test_a_newborn_target_is_at_rest_with_even_odds(velocity_std):
    newborn = stationary.probability_slower(*velocities([0.0, 0.0], velocity_std), BOUND)
    even = stationary.at_even_odds(newborn, BOUND, velocity_std)
    np.testing.assert_allclose(even, 0.5, rtol=1e-9)


def test_odds_are_multiplied_by_the_same_factor():
    probability = np.array([0.0, 0.02, 0.3, 0.9, 1.0])
    even = stationary.at_even_odds(probability, BOUND, 5.0)
    assert even[0] == 0.0
    assert even[-1] == 1.0
    ratio = even[1:-1] / (1.0 - even[1:-1]) / (probability[1:-1] / (1.0 - probability[1:-1]))
    prior = 1.0 - np.exp(-0.5 * (BOUND / 5.0) ** 2)
    np.testing.assert_allclose(ratio, (1.0 - prior) / prior)


def test_where_newborn_targets_are_all_slower_or_all_faster_nothing_changes():
    probability = np.array([0.0, 0.3, 1.0])
    np.testing.assert_array_equal(stationary.at_even_odds(probability, 0.0, 5.0)[:1], [0.0])
    everything = stationary.at_even_odds(np.array([1.0]), 1e3, 1.0)
    np.testing.assert_array_equal(everything, [1.0])


def test_among_reflectors_rest_is_likelier_unless_the_velocity_is_measured():
    probability = np.array([0.0, 0.1, 0.5, 1.0])
    np.testing.assert_array_equal(
        stationary.among_reflectors(probability, np.zeros(4)), probability
    )
    among = stationary.among_reflectors(probability, np.full(4, 0.9))
    # The odds are ten times as large.
    np.testing.assert_allclose(among, [0.0, 10.0 / 19.0, 10.0 / 11.0, 1.0])


def test_a_target_at_rest_is_clutter_only_if_it_is_to_every_radar():
    plain = View.of(radar(), Detections(np.zeros((0, 2)), None))
    mapped, slower = (ClutterMap(POLAR, speed=speed).expect(plain) for speed in (3.0, 2.0))
    assert stationary_speed([mapped]) == 3.0
    assert stationary_speed([mapped, slower]) == 2.0
    assert stationary_speed([mapped, plain]) == 0.0
    assert stationary_speed([]) == 0.0
