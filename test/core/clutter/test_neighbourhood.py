import numpy as np
import pytest

from phd_jdtc_ros.core.clutter import neighbourhood
from phd_jdtc_ros.core.clutter.grid import HALF, GroundGrid, PolarGrid
from phd_jdtc_ros.core.clutter.map import ClutterMap
from phd_jdtc_ros.core.clutter.neighbourhood import (
    OWN,
    REACH,
    detections_around,
    probability_among_reflectors,
)


def stored(grid, rows, columns, count):
    """Return the cells and their counts as a map has them."""
    cell, place = np.unique(rows * grid.columns + columns, return_inverse=True)
    return cell, np.bincount(place, weights=count)


@pytest.mark.parametrize(
    ("grid", "first"),
    [(PolarGrid(30.0, 50), (0, 0)), (PolarGrid(30.0, 7), (0, 0)), (GroundGrid(60.0), (HALF, HALF))],
)
def test_it_is_the_number_of_detections_in_the_square_without_the_place_itself(grid, first):
    """Also at the seam of the azimuths and at the radar, and if the square is wider than a turn."""
    rng = np.random.default_rng(4)
    wide = min(grid.columns, 60)
    rows, columns = rng.integers(0, 40, 400), rng.integers(0, wide, 400)
    count = rng.exponential(1.0, 400)
    cell, counts = stored(grid, first[0] + rows, first[1] + columns, count)
    centre = np.array([[0, 20, 39, 5, 11], [0, 3, wide - 1, 6, wide - 4]])
    places = centre + np.array(first)[:, None] + rng.uniform(-0.4, 0.4, centre.shape)
    found = detections_around(grid, cell, counts, places)
    for k, (row, column) in enumerate(centre.T):
        down = np.abs(rows - row)
        across = np.abs(columns - column)
        if isinstance(grid, PolarGrid):
            across = np.minimum(across, grid.columns - across)
        wide_square = (down <= REACH) & (across <= REACH)
        own = (down <= OWN) & (across <= OWN)
        assert found[k] == pytest.approx(count[wide_square & ~own].sum())


def test_the_number_of_cells_is_that_of_the_square_without_the_place_itself():
    grid = GroundGrid(60.0)
    side = np.arange(-REACH - 3, REACH + 4)
    rows, columns = (HALF + part.ravel() for part in np.meshgrid(side, side))
    cell, counts = stored(grid, rows, columns, np.ones(len(rows)))
    (found,) = detections_around(grid, cell, counts, np.array([[HALF], [HALF]]))
    assert found == neighbourhood.CELLS


def test_a_neighbourhood_answers_the_more_the_more_of_it_does():
    places = ClutterMap(PolarGrid(30.0, 50))
    np.testing.assert_array_equal(
        places.neighbourhood_excess(np.array([[1e3, 0.5]]), np.zeros((1, 2)), 10.0, 2e4), 0.0
    )
    np.testing.assert_allclose(
        probability_among_reflectors(np.array([0.0, neighbourhood.EVEN_EXCESS, 1e9])),
        [0.0, 0.5, 1.0],
    )
