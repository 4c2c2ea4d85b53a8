"""Sites against PROJ's own topocentric coordinates."""

import math

import numpy as np
import pyproj
import pytest
from topocentric import seen_from

from phd_jdtc_ros.core.sensors import wgs84
from phd_jdtc_ros.core.sensors.site import Site
from phd_jdtc_ros.earth import SystemPlane

# Origin, and where the radar stands: latitude, longitude and height.
SCENES = [
    ((52.3, 4.8, 0.0), (52.3, 4.8, 30.0)),
    ((52.3, 4.8, 0.0), (54.6, 8.1, 120.0)),
    ((-33.9, 179.6, 25.0), (-33.0, -178.9, 700.0)),
    ((0.0, -60.0, 0.0), (-1.5, -62.0, -300.0)),
    ((69.7, 18.9, 0.0), (72.5, 25.0, 2000.0)),
]
GEOD = pyproj.Geod(ellps="WGS84")
# PROJ's, from longitude, latitude and height.
GEOCENTRIC = pyproj.Transformer.from_pipeline(
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84"
)


def targets(place, height, distances=(500.0, 30e3, 150e3, 400e3)):
    """Return latitudes, longitudes and heights around a radar, all azimuths at all distances."""
    bearing, distance = np.meshgrid(np.arange(0.0, 360.0, 15.0), distances)
    bearing, distance = bearing.ravel(), distance.ravel()
    count = len(bearing)
    longitude, latitude, _ = GEOD.fwd(
        np.full(count, place[1]), np.full(count, place[0]), bearing, distance
    )
    return latitude, longitude, np.full(count, height)


def measured(place, latitude, longitude, height):
    """Return slant ranges, azimuths from true east, and sines of elevations, by PROJ."""
    east, north, up = seen_from(*place).transform(longitude, latitude, height)
    slant = np.sqrt(east**2 + north**2 + up**2)
    return slant, np.arctan2(north, east), up / slant


@pytest.mark.parametrize(("origin", "place"), SCENES)
@pytest.mark.parametrize("height", [-300.0, 0.0, 3000.0, 12500.0])
@pytest.mark.parametrize("turned", [0.0, math.radians(0.3)])
def test_plots_of_known_height_are_placed_to_a_millimetre(origin, place, height, turned):
    plane = SystemPlane(origin)
    site = Site(place, plane, turned)
    latitude, longitude, heights = targets(place, height)
    slant, azimuth, _ = measured(place, latitude, longitude, heights)
    sine = site.elevation_of(slant, azimuth - turned, heights)
    distance, direction = site.to_ground(slant, azimuth - turned, sine)
    bearing = direction + site.yaw
    x = site.position[0] + distance * np.cos(bearing)
    y = site.position[1] + distance * np.sin(bearing)
    expected_x, expected_y = plane.to_plane(latitude, longitude)
    np.testing.assert_allclose(np.hypot(x - expected_x, y - expected_y), 0.0, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize(("origin", "place"), SCENES)
def test_slant_ranges_and_elevations_are_those_of_proj(origin, place):
    site = Site(place, SystemPlane(origin))
    latitude, longitude, heights = targets(place, 9000.0)
    slant, azimuth, sine = measured(place, latitude, longitude, heights)
    np.testing.assert_allclose(
        site.elevation_of(slant, azimuth, heights), sine, rtol=0.0, atol=1e-9
    )
    plane = SystemPlane(origin)
    site = Site(place, plane)
    latitude, longitude, heights = targets(place, 11e3)
    expected, azimuth, _ = measured(place, latitude, longitude, heights)
    x, y = np.subtract(plane.to_plane(latitude, longitude), np.reshape(site.position, (2, 1)))
    found, direction = site.to_slant(np.hypot(x, y), np.arctan2(y, x) - site.yaw, heights)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3)
    apart = (direction - azimuth + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(apart * expected, 0.0, rtol=0.0, atol=1e-3)


def test_high_targets_may_have_no_ground_range_or_elevation():
    site = Site((52.3, 4.8, 30.0), SystemPlane((52.0, 4.0, 0.0)))
    height = np.array([10030.0])
    sine = site.elevation_of(np.array([10e3]), np.array([0.4]), height)
    assert sine[0] == pytest.approx(1.0, abs=1e-12)
    assert site.to_ground(np.array([10e3]), np.array([0.4]), np.minimum(sine, 1.0))[0][0] < 0.1
    sine = site.elevation_of(np.array([9e3, 9e3]), np.zeros(2), np.array([10e3, -9.5e3]))
    assert sine[0] > 1.0
    assert sine[1] < -1.0


def test_a_radar_at_the_origin_looks_to_true_north():
    site = Site((52.0, 4.0, 0.0), SystemPlane((52.0, 4.0, 0.0)))
    assert np.allclose(site.position, 0.0, atol=1e-6)
    assert site.yaw == pytest.approx(0.0, abs=1e-9)


def test_the_earths_curvature_is_what_it_is():
    # 200 km away, a target at the radar's height is 3.1 km below its horizontal plane.
    site = Site((52.0, 4.0, 0.0), SystemPlane((52.0, 4.0, 0.0)))
    sine = site.elevation_of(np.array([200e3]), np.array([0.0]), np.array([0.0]))
    assert -sine[0] * 200e3 == pytest.approx(200e3**2 / (2.0 * 6.39e6), rel=2e-3)


def places():
    """Return latitudes, longitudes and heights all over the earth, the poles among them."""
    rng = np.random.default_rng(0)
    latitude = np.concatenate([[90.0, -90.0, 0.0, 0.0], rng.uniform(-90.0, 90.0, 1000)])
    longitude = np.concatenate([[0.0, 0.0, 180.0, -90.0], rng.uniform(-180.0, 180.0, 1000)])
    height = np.concatenate([[0.0, 30e3, -300.0, 12e3], rng.uniform(-500.0, 30e3, 1000)])
    return latitude, longitude, height


def test_cartesian_places_are_those_of_proj():
    latitude, longitude, height = places()
    expected = np.stack(GEOCENTRIC.transform(longitude, latitude, height), axis=-1)
    found = wgs84.to_cartesian(latitude, longitude, height)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)


def test_cartesian_places_come_back():
    latitude, longitude, height = places()
    back = wgs84.to_geodetic(wgs84.to_cartesian(latitude, longitude, height))
    # 1e-11 degrees are a micrometre.
    np.testing.assert_allclose(back[0], latitude, rtol=0.0, atol=1e-11)
    apart = (back[1] - longitude + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart[2:], 0.0, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(back[2], height, rtol=0.0, atol=1e-6)


def test_axes_are_those_of_the_place():
    latitude, longitude = 52.3, 4.8
    here = wgs84.to_cartesian(latitude, longitude, 10.0)
    steps = [(0.0, 1e-6, 0.0), (1e-6, 0.0, 0.0), (0.0, 0.0, 1.0)]
    moved = [
        wgs84.to_cartesian(latitude + north, longitude + east, 10.0 + up) - here
        for north, east, up in steps
    ]
    expected = [line / np.linalg.norm(line) for line in moved]
    np.testing.assert_allclose(
        wgs84.east_north_up(latitude, longitude), expected, rtol=0.0, atol=1e-6
    )
