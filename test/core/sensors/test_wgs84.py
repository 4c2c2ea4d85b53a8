import numpy as np
import pyproj

from phd_jdtc_ros.core.sensors import wgs84

# PROJ's, from longitude, latitude and height.
GEOCENTRIC = pyproj.Transformer.from_pipeline(
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84"
)


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
