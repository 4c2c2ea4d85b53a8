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


def test_within_counts_every_azimuth_once():
    sectors = [Coverage(0.3 + k * FULL_TURN / 16, FULL_TURN / 16) for k in range(16)]
    total = sum(sector_probability(TURN, sector, STD) for sector in sectors)
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    share = sector_probability(np.array([0.0, 1.0]), Coverage(0.0, 1.0), STD)
    np.testing.assert_allclose(share, 0.5, atol=1e-9)
    assert (sector_probability(TURN, Coverage(1.0, FULL_TURN), STD) == 1.0).all()


@pytest.mark.parametrize("width", [0.0, -1.0, 7.0, np.nan])
def test_coverage_must_be_a_part_of_a_turn(width):
    with pytest.raises(ValueError, match="coverage"):
        Coverage(0.0, width)


def test_probability_is_linear_and_bounded():
    seen = Visibility(100e3, ranges=(10e3, 50e3, 100e3), probabilities=(0.95, 0.9, 0.5))
    expected = [0.95, 0.95, 0.925, 0.7, 0.5]
    distance = np.array([0.0, 10e3, 30e3, 75e3, 120e3])
    np.testing.assert_allclose(seen.probability(distance), expected)
    found = LIMITED.probability(np.array([90e3]), np.array([100.0]))
    np.testing.assert_allclose(found, LIMITED.probability(np.array([90e3])))


def test_sees_what_is_in_range_in_the_field_and_not_hidden():
    seen = Visibility(
        max_range=10e3,
        min_range=500.0,
        fov=Coverage(-1.0, 2.0),
        blind=(Coverage(0.2, 0.1),),
    )
    measured = np.array([[400.0, 0.0], [600.0, 0.0], [11e3, 0.0], [5e3, 1.1], [5e3, 0.25]])
    assert seen.probability_in_view(measured).tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]


LIMITED = Visibility(
    *(60e3, 500.0, Coverage(-1.0, 2.0), (Coverage(0.2, 0.1), Coverage(0.25, 0.15))),
    ranges=(10e3, 50e3, 100e3),
    probabilities=(0.95, 0.9, 0.5),
)
# Means and standard deviations of (range, azimuth): near every limit, far inside, and outside.
PLACES = np.array([[450.0, 0.0], [30e3, 0.19], [30e3, 0.42], [59e3, 0.9], [62e3, 0.0], [9e3, -1.1]])
SPREAD = np.array([[300.0, 0.1], [2e3, 0.02], [9e3, 0.3], [3e3, 0.05], [2e3, 0.5], [4e3, 0.2]])


def drawn_around(place, spread):
    """Return a million (range, azimuth) rows of a normal density, with ranges above 0."""
    drawn = place + spread * np.random.default_rng(1).standard_normal((10**6, 2))
    return drawn[drawn[:, 0] > 0.0]


@pytest.mark.parametrize("row", range(len(PLACES)))
def test_sees_and_probability_of_a_density_are_means_over_its_places(row):
    drawn = drawn_around(PLACES[row], SPREAD[row])
    found = LIMITED.probability_in_view(PLACES[[row]], SPREAD[[row]])[0]
    assert found == pytest.approx(LIMITED.probability_in_view(drawn).sum() / 10**6, abs=3e-3)
    distance = drawn_around(PLACES[row], SPREAD[row])[:, 0]
    inside = distance[(distance >= LIMITED.min_range) & (distance <= LIMITED.max_range)]
    found = LIMITED.probability(PLACES[[row], 0], SPREAD[[row], 0])[0]
    assert found == pytest.approx(LIMITED.probability(inside).mean(), abs=3e-4)


@pytest.mark.parametrize("std", [0.1, 1.0, 2.5])
def test_sector_of_a_wide_density_is_its_share_of_the_wrapped_azimuths(std):
    sector = Coverage(0.1, FULL_TURN - 0.7)
    azimuth = 0.2 + std * np.random.default_rng(2).standard_normal(10**6)
    found = sector_probability(np.array([0.2]), sector, std)[0]
    assert found == pytest.approx(sector_probability(azimuth, sector).mean(), abs=3e-3)
