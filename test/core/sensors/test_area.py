"""Areas: the probability that a place is inside, against a sum over a fine grid of the density."""

import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.sensors.position import Area, farthest

RECTANGLE = Area.rectangle(-1.0, -2.0, 3.0, 4.0)
ANGLE = Area(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]]))
CLOCKWISE = Area(np.array([[1.0, 3.0], [3.0, 1.0], [0.0, 0.0]]))
AREAS = pytest.mark.parametrize("area", [RECTANGLE, ANGLE, CLOCKWISE], ids=["box", "L", "triangle"])
# Far inside, outside, at a corner, and on a side.
PLACES = np.array([[0.5, 0.5], [9.0, 9.0], [0.0, 0.0], [3.0, 1.0], [1.7, -0.4]])
CELLS = 2000


def summed(area, mean, std):
    """Return the probability by the midpoint rule, within six deviations."""
    side = (np.arange(CELLS) + 0.5) / CELLS * 12.0 - 6.0
    x, y = (m + s * side for m, s in zip(mean, std, strict=True))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = norm.pdf(side) * 12.0 / CELLS
    inside = area.probability(grid).reshape(CELLS, CELLS)
    return weight @ inside @ weight


@AREAS
def test_probability_is_the_integral_of_the_density(area):
    std = np.array([[0.3, 0.2], [1.0, 2.0], [0.5, 1.5], [2.0, 0.1], [0.7, 0.7]])
    found = area.probability(PLACES, std)
    expected = [summed(area, *each) for each in zip(PLACES, std, strict=True)]
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert found[1] < 1e-4


def test_rectangle_as_any_polygon_has_the_same_probability():
    turned = Area(np.roll(RECTANGLE.corners, 1, axis=0))
    turned.__dict__["is_rectangle"] = False  # The general way
    std = np.full((5, 2), [0.8, 1.3])
    np.testing.assert_allclose(
        turned.probability(PLACES, std), RECTANGLE.probability(PLACES, std), atol=1e-14
    )
    assert turned.probability(PLACES).tolist() == [1.0, 0.0, 1.0, 0.0, 1.0]


@AREAS
def test_nearly_certain_places_are_in_or_out(area):
    inside = np.array([[0.5, 0.4], [-5.0, 0.0], [2.0, 8.0]])
    np.testing.assert_array_equal(area.probability(inside), [1.0, 0.0, 0.0])
    tiny = np.full((3, 2), 1e-6)
    np.testing.assert_allclose(area.probability(inside, tiny), [1.0, 0.0, 0.0], atol=1e-12)


def test_sizes_and_extents():
    assert (RECTANGLE.signed_size, ANGLE.signed_size, CLOCKWISE.signed_size) == (24.0, 6.0, -4.0)
    assert [each.is_rectangle for each in (RECTANGLE, ANGLE, CLOCKWISE)] == [True, False, False]
    np.testing.assert_array_equal(ANGLE.bounds, [[0.0, 4.0], [0.0, 3.0]])
    assert farthest(RECTANGLE) == pytest.approx(5.0)
