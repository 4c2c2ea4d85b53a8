import math
import pickle

import numpy as np
import pytest
from pyproj import Geod

from phd_jdtc_ros.earth import SystemPlane

ORIGINS = [(52.3, 4.8), (-33.9, 179.6), (0.0, -60.0), (78.2, 15.5), (90.0, 0.0), (-90.0, 0.0)]
# Semi-axes of WGS84, metres.
SEMI_MAJOR, SEMI_MINOR = 6378137.0, 6356752.314245
GEOD = Geod(ellps="WGS84")


def plane_about(latitude, longitude):
    return SystemPlane([latitude, longitude, 0.0])


def places_about(latitude, longitude, distance):
    """Return latitudes and longitudes at a distance, metres, in twelve directions."""
    bearing = np.arange(0.0, 360.0, 30.0)
    count = len(bearing)
    east, north, _ = GEOD.fwd(
        np.full(count, longitude), np.full(count, latitude), bearing, np.full(count, distance)
    )
    return north, east


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("distance", [1.0, 100e3, 400e3])
def test_places_come_back_from_the_plane(origin, distance):
    plane, (north, east) = plane_about(*origin), places_about(*origin, distance)
    back_north, back_east = plane.to_geodetic(*plane.to_plane(north, east))
    # 1e-8 degrees are a millimetre.
    np.testing.assert_allclose(back_north, north, rtol=0.0, atol=1e-8)
    apart = (back_east - east + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart * np.cos(np.radians(north)), 0.0, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("distance", [10e3, 100e3, 200e3, 400e3])
def test_lengths_grow_with_the_square_of_the_distance(origin, distance):
    plane, (north, east) = plane_about(*origin), places_about(*origin, distance)
    for bearing in (0.0, 45.0, 90.0):
        east_1, north_1, _ = GEOD.fwd(
            east, north, np.full(len(east), bearing), np.full(len(east), 10.0)
        )
        step = np.subtract(plane.to_plane(north_1, east_1), plane.to_plane(north, east))
        scale = np.hypot(*step) / 10.0
        expected = 1.0 + (distance / (2.0 * 6371e3)) ** 2
        # The radius of the earth differs by 0.7 % with the place and the direction.
        np.testing.assert_allclose(scale - 1.0, expected - 1.0, rtol=0.03, atol=2e-8)


@pytest.mark.parametrize("origin", ORIGINS[:4])
def test_angles_stay_right_at_400_km(origin):
    plane, (north, east) = plane_about(*origin), places_about(*origin, 400e3)
    yaw = plane.convergence(north, east)
    for bearing in (0.0, 50.0, 140.0, 260.0):
        east_1, north_1, _ = GEOD.fwd(
            east, north, np.full(len(east), bearing), np.full(len(east), 10.0)
        )
        step = np.subtract(plane.to_plane(north_1, east_1), plane.to_plane(north, east))
        direction = np.arctan2(step[1], step[0])
        apart = direction - (math.radians(90.0 - bearing) + yaw)
        apart = (apart + np.pi) % (2.0 * np.pi) - np.pi
        np.testing.assert_allclose(apart, 0.0, rtol=0.0, atol=1e-6)


def test_convergence_is_the_lean_of_meridians():
    # There the meridians lean to the left: those of places in the east meet that of the origin.
    assert plane_about(52.0, 4.0).convergence(52.0, 6.0) == pytest.approx(
        math.radians(2.0) * math.sin(math.radians(52.0)), rel=1e-3
    )
    assert plane_about(-52.0, 4.0).convergence(-52.0, 6.0) < 0.0
    assert plane_about(52.0, 4.0).convergence(52.5, 4.0) == pytest.approx(0.0, abs=1e-9)
    assert plane_about(90.0, 0.0).convergence(90.0, 30.0) == pytest.approx(math.radians(30.0))
    assert plane_about(-90.0, 0.0).convergence(-90.0, 30.0) == pytest.approx(math.radians(-30.0))


def test_east_is_x_and_north_is_y():
    x, y = plane_about(52.0, 4.0).to_plane([52.0, 53.0], [4.1, 4.0])
    # Lengths of 0.1 degrees of the parallel and of 1 degree of the meridian.
    flattening = 1.0 - SEMI_MINOR / SEMI_MAJOR
    square = flattening * (2.0 - flattening)
    across = SEMI_MAJOR / math.sqrt(1.0 - square * math.sin(math.radians(52.0)) ** 2)
    assert x[0] == pytest.approx(
        math.radians(0.1) * across * math.cos(math.radians(52.0)), rel=1e-5
    )
    assert y[0] == pytest.approx(0.0, abs=10.0)
    assert x[1] == pytest.approx(0.0, abs=1e-6)
    assert y[1] == pytest.approx(GEOD.inv(4.0, 52.0, 4.0, 53.0)[2], rel=1e-4)


def test_the_antimeridian_is_no_border():
    plane = plane_about(10.0, 179.9)
    x, _ = plane.to_plane([10.0, 10.0, 10.0], [-179.9, 180.1, 539.9 + 0.2])
    np.testing.assert_allclose(x, x[0], rtol=1e-12)
    assert 0.0 < x[0] < 25e3


def test_arrays_keep_their_shape_and_nan():
    plane = plane_about(52.0, 4.0)
    x, y = plane.to_plane(np.full((2, 3), 52.5), 4.5)
    assert x.shape == y.shape == (2, 3)
    assert all(found.shape == (0,) for found in plane.to_plane([], []))
    assert plane.convergence([], []).shape == (0,)
    assert all(found.shape == () for found in plane.to_geodetic(1.0, 2.0))
    x, y = plane.to_plane([math.nan, 52.5], [4.0, 4.5])
    north, east = plane.to_geodetic([math.nan, 1.0], [0.0, 1.0])
    yaw = plane.convergence([52.5, math.nan], [4.5, 4.0])
    assert np.isnan([x[0], y[0], north[0], east[0], yaw[1]]).all()
    assert np.isfinite([x[1], y[1], north[1], east[1], yaw[0]]).all()


def test_latitudes_beyond_a_pole_are_refused():
    with pytest.raises(ValueError, match=r"latitude: 90\.5 given, must be from -90 to 90 degrees"):
        plane_about(52.0, 4.0).to_plane([52.0, 90.5], 4.0)
    with pytest.raises(ValueError, match="latitude"):
        plane_about(52.0, 4.0).convergence(-91.0, 4.0)


@pytest.mark.parametrize(
    "origin", [[91.0, 4.0, 0.0], [52.0, 4.0], [52.0, math.nan, 0.0], [52.0, 4.0, math.inf]]
)
def test_an_impossible_origin_is_refused(origin):
    with pytest.raises(ValueError, match="origin"):
        SystemPlane(origin)


def test_planes_of_one_origin_are_equal_and_survive_pickling():
    plane = SystemPlane([52.0, 4.0, -3.0])
    assert pickle.loads(pickle.dumps(plane)) == plane == SystemPlane((52.0, 4.0, -3.0))
    assert plane != SystemPlane([52.0, 4.0, 0.0])
