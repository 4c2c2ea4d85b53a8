"""The picture of a map of clutter lies where the clutter is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.clutter.grid import GroundGrid, PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.models.clutter_raster import MAX_CELLS, raster
from phd_jdtc_ros.core.types import Pose

STD = np.array([10.0, math.radians(0.2)])
# Off the axes, and twice as much at the second.
PLACES = np.array([[1500.0, -3200.0], [-2400.0, 1700.0], [-2400.0, 1700.0]])


TURNED = Pose((400.0, -700.0), math.radians(130.0))


def radar(name="mast", pose=TURNED):
    return replace(small().model.radars[0], name=name).at(pose)


def learned(grid, seen_from, places=PLACES, turns=20):
    """Return the map after reflectors at places have answered, from a pose for each turn."""
    found = ClutterMap(grid)
    for turn in range(turns):
        own = seen_from[turn % len(seen_from)]
        state = np.zeros((len(places), 5))
        state[:, [0, 2]] = places
        seen = own.measure(state)
        found = found.after(seen, own.to_world(seen), np.ones(len(seen)), 1.0)
    return found


POLAR = PolarGrid.of_noise(*STD)
GROUND = GroundGrid.of_noise(*STD, 10e3)
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
def test_densities_are_detections_per_turn_and_area(grid):
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
