import math

import pytest

from phd_jdtc_ros.simulation.traffic.geodesy import EARTH_RADIUS, east_north

ORIGIN = (52.0, 7.0)


def test_the_origin_is_at_zero_with_north_up_and_east_right():
    assert east_north(ORIGIN, ORIGIN) == (0.0, 0.0)
    east, north = east_north((53.0, 7.0), ORIGIN)
    assert east == pytest.approx(0.0, abs=1e-6)
    assert north == pytest.approx(60.0 * 1852.0, rel=2e-3)
    east, north = east_north((52.0, 7.5), ORIGIN)
    half_a_degree = math.radians(0.5) * EARTH_RADIUS * math.cos(math.radians(52.0))
    assert east == pytest.approx(half_a_degree, rel=1e-3)
    assert 0.0 < north < 0.01 * east


@pytest.mark.parametrize("place", [(49.3, 7.9), (54.0, 10.0), (50.9, 4.6), (52.0, 12.0)])
def test_distances_from_the_origin_are_those_on_the_sphere(place):
    (lat, lon), (lat_0, lon_0) = (map(math.radians, point) for point in (place, ORIGIN))
    haversine = (
        math.sin(0.5 * (lat - lat_0)) ** 2
        + math.cos(lat) * math.cos(lat_0) * math.sin(0.5 * (lon - lon_0)) ** 2
    )
    expected = 2.0 * EARTH_RADIUS * math.asin(math.sqrt(haversine))
    assert math.hypot(*east_north(place, ORIGIN)) == pytest.approx(expected, rel=1e-9)
