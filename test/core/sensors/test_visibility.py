import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phd_jdtc_ros.core.sensors.visibility import Visibility, sector_probability
from phd_jdtc_ros.core.types import FULL_TURN, Coverage

STD = np.radians(0.5)
TURN = np.linspace(-np.pi, np.pi, 721)


@given(start=st.floats(-10.0, 10.0), width=st.floats(0.01, FULL_TURN))
def test_within_without_noise_is_inside_or_outside(start, width):
    sector = Coverage(start, width)
    inside = sector_probability(start + width * np.array([1e-6, 0.5, 1.0 - 1e-6]), sector)
    assert inside.tolist() == [1.0, 1.0, 1.0]
    if width < FULL_TURN - 0.01:
        assert sector_probability(
            np.array([start - 0.004, start + width + 0.004]), sector
        ).tolist() == [0, 0]


def test_within_of_a_turn_of_sectors_counts_every_azimuth_once():
    sectors = [Coverage(0.3 + k * FULL_TURN / 16, FULL_TURN / 16) for k in range(16)]
    total = sum(sector_probability(TURN, sector, STD) for sector in sectors)
    np.testing.assert_allclose(total, 1.0, atol=1e-12)


def test_within_at_the_edge_is_a_half():
    share = sector_probability(np.array([0.0, 1.0]), Coverage(0.0, 1.0), STD)
    np.testing.assert_allclose(share, 0.5, atol=1e-9)


def test_within_a_whole_turn_has_no_edge():
    assert (sector_probability(TURN, Coverage(1.0, FULL_TURN), STD) == 1.0).all()


@pytest.mark.parametrize("width", [0.0, -1.0, 7.0, np.nan])
def test_coverage_must_be_a_part_of_a_turn(width):
    with pytest.raises(ValueError, match="coverage"):
        Coverage(0.0, width)


def test_probability_is_linear_between_the_ranges_of_the_table():
    seen = Visibility(100e3, ranges=(10e3, 50e3, 100e3), probabilities=(0.95, 0.9, 0.5))
    expected = [0.95, 0.95, 0.925, 0.7, 0.5]
    distance = np.array([0.0, 10e3, 30e3, 75e3, 120e3])
    np.testing.assert_allclose(seen.probability(distance), expected)


def test_sees_what_is_in_range_in_the_field_and_not_hidden():
    seen = Visibility(
        max_range=10e3,
        min_range=500.0,
        fov=Coverage(-1.0, 2.0),
        blind=(Coverage(0.2, 0.1),),
    )
    measured = np.array([[400.0, 0.0], [600.0, 0.0], [11e3, 0.0], [5e3, 1.1], [5e3, 0.25]])
    assert seen.sees(measured).tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]
