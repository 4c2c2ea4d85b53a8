import numpy as np
import pytest

from phd_jdtc_ros.core.intake.sectors import coverage_of, is_sector, sector_of
from phd_jdtc_ros.core.sensors.visibility import sector_probability


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("sectors", [1, 2, 3, 16, 32])
def test_sectors_share_the_turn_and_are_found_again(sectors, compass):
    azimuth = np.random.default_rng(0).uniform(-np.pi, np.pi, 500)
    seen = sum(
        sector_probability(azimuth, coverage_of(k, sectors, compass)) for k in range(sectors)
    )
    np.testing.assert_array_equal(seen, 1.0)
    found = [sector_of(coverage_of(k, sectors, compass), sectors, compass) for k in range(sectors)]
    assert found == list(range(sectors))


def test_sectors_are_counted_as_azimuths_are():
    east, north_east = np.radians([1.0]), np.radians([89.0])
    assert sector_probability(east, coverage_of(0, 4, compass=False)) == 1.0
    # Clockwise from north, the first quarter turn ends in the east.
    assert sector_probability(north_east, coverage_of(0, 4, compass=True)) == 1.0
    assert sector_probability(-east, coverage_of(1, 4, compass=True)) == 1.0


def test_is_sector_believes_a_number_but_for_most_detections_elsewhere():
    sector = coverage_of(0, 16, compass=False)
    assert is_sector(np.array([0.1, 0.2, 2.0]), sector)
    assert not is_sector(np.array([0.1, 2.2, 2.0]), sector)
    assert is_sector(np.array([2.2, 2.0]), sector)
