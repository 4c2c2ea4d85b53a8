"""Estimates by latitude and longitude: places, NavSatFix and GeoJSON."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pyproj import Geod
from samples import STAMP_NS, estimates, nothing

from msg_adapters.encoding import stamps
from msg_adapters.targets import geo_json, geodetic
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, UNKNOWN, Attributes
from phd_jdtc_ros.earth import SystemPlane

PLANE = SystemPlane((52.3, 4.8, 5.0))
GEOD = Geod(ellps="WGS84")
NAMES = ("small", "large")


def at(*states, **changes):
    """Return estimates of (x, vx, y, vy) rows, with track numbers from 1."""
    given = estimates(len(states))
    state = np.zeros((len(states), 5))
    state[:, :4] = states
    return replace(given, state=state, track_id=np.arange(1, len(states) + 1), **changes)


@pytest.mark.parametrize("place", [(0.0, 0.0), (200e3, 250e3), (-300e3, 100e3), (50e3, -350e3)])
@pytest.mark.parametrize("bearing", [0.0, 70.0, 200.0, 359.0])
def test_courses_are_from_true_north(place, bearing):
    latitude, longitude = map(float, PLANE.to_geodetic(*place))
    east, north, _ = GEOD.fwd(longitude, latitude, bearing, 1.0)
    (x,), (y,) = PLANE.to_plane([north], [east])
    given = at((place[0], 200.0 * (x - place[0]), place[1], 200.0 * (y - place[1])))
    found = geodetic.of(given, PLANE)
    assert found.latitude[0] == pytest.approx(latitude, abs=1e-12)
    assert found.longitude[0] == pytest.approx(longitude, abs=1e-12)
    apart = (found.course[0] - bearing + 180.0) % 360.0 - 180.0
    assert apart == pytest.approx(0.0, abs=1e-4)
    assert found.speed[0] == pytest.approx(200.0, rel=1.5e-3)


def test_unknown_places_are_nan_and_none_of_nothing():
    found = geodetic.of(at((1e3, 0.0, 2e3, 0.0)), PLANE)
    assert np.isnan([found.course[0], found.height[0]]).all()
    assert found.speed[0] == 0.0
    assert all(column.shape == (0,) for column in geodetic.of(nothing(), PLANE))
    assert geodetic.to_msgs(nothing(), PLANE) == []
    assert geo_json.of_scan(nothing(), PLANE, NAMES, {})["features"] == []


def test_fixes_are_of_the_labelled_tracks_in_order():
    given = replace(estimates(), track_id=np.array([12, 0, 5]))
    first, second = geodetic.to_msgs(given, PLANE)
    assert [first.header.frame_id, second.header.frame_id] == ["track_5", "track_12"]
    assert {stamps.to_ns(message.header.stamp) for message in (first, second)} == {STAMP_NS}
    places = geodetic.of(given, PLANE)
    assert (first.latitude, first.longitude) == (places.latitude[2], places.longitude[2])
    assert math.isnan(first.altitude)
    assert first.status.status == first.status.STATUS_FIX
    assert first.position_covariance_type == first.COVARIANCE_TYPE_KNOWN


def test_covariances_of_fixes_are_to_true_east_and_north():
    x, y = 300e3, 150e3
    yaw = float(PLANE.convergence(*PLANE.to_geodetic(x, y)))
    assert abs(yaw) > math.radians(2.0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    # A long ellipse to the true east, whose axes in the plane are turned by the convergence.
    axes = np.array([[cos, -sin], [sin, cos]])
    covariance = np.zeros((1, 5, 5))
    covariance[0][np.ix_([0, 2], [0, 2])] = axes @ np.diag([400.0, 25.0]) @ axes.T
    (message,) = geodetic.to_msgs(at((x, 10.0, y, 0.0), covariance=covariance), PLANE)
    found = np.reshape(message.position_covariance, (3, 3))
    np.testing.assert_allclose(found[:2, :2], np.diag([400.0, 25.0]), rtol=0.0, atol=1e-9)
    assert found[2, 2] == 1e6


def test_estimated_heights_are_above_the_origins():
    covariance = np.tile(np.diag([100.0, 4.0]), (2, 1, 1))
    covariance[1] = np.nan
    known = Attributes(
        np.array([[3000.0, 5.0], [np.nan, np.nan]]),
        covariance,
        np.full(2, UNKNOWN),
        np.full(2, UNKNOWN),
    )
    given = at((0.0, 10.0, 0.0, 0.0), (1e3, 10.0, 0.0, 0.0), attributes=known)
    first, second = geodetic.to_msgs(given, PLANE)
    assert first.altitude == 3005.0
    assert math.isnan(second.altitude)
    assert (first.position_covariance[8], second.position_covariance[8]) == (100.0, 1e6)
    points = geo_json.of_scan(given, PLANE, NAMES, {})["features"]
    assert [point["properties"]["height"] for point in points] == [3005.0, None]
    assert [len(point["geometry"]["coordinates"]) for point in points] == [3, 2]


def test_geojson_has_a_point_and_a_line_for_each_track():
    given = at((0.0, 100.0, 0.0, 0.0), (10e3, 0.0, 20e3, -50.0))
    given = replace(given, class_id=np.array([0, 1]), track_state=np.array([CONFIRMED, COASTING]))
    none = math.nan
    trails = {1: np.array([[-1e3, 0.0, 9.0], [0.0, 0.0, none]]), 2: np.array([[10e3, 20e3, none]])}
    document = json.loads(geo_json.text(geo_json.of_scan(given, PLANE, NAMES, trails)))
    assert document["type"] == "FeatureCollection"
    point, line, other = document["features"]
    assert point["geometry"] == {"type": "Point", "coordinates": [4.8, 52.3]}
    assert line["geometry"]["type"] == "LineString"
    assert line["geometry"]["coordinates"][1] == [4.8, 52.3]
    assert line["geometry"]["coordinates"][0][0] == pytest.approx(4.8 - 0.01466, abs=1e-4)
    assert point["properties"]["name"] == "1"
    assert point["properties"]["course"] == pytest.approx(90.0)
    assert point["properties"]["height"] is None
    assert other["properties"]["class"] == "large"
    assert other["properties"]["state"] == "coasting"
    assert other["properties"]["style"]["color"] != point["properties"]["style"]["color"]


def test_geojson_has_identities_and_flight_levels_where_they_are_known():
    known = Attributes(
        np.array([[3048.0, 0.0], [np.nan, np.nan]]),
        np.array([np.eye(2), np.full((2, 2), np.nan)]),
        np.array([0o42, UNKNOWN]),
        np.array([0x3C6444, UNKNOWN]),
    )
    given = at((0.0, 100.0, 0.0, 0.0), (10e3, 0.0, 20e3, -50.0), attributes=known)
    trails = {1: np.array([[-1e3, 0.0, 3048.0], [0.0, 0.0, 3043.0]])}
    point, line, other = geo_json.of_scan(given, PLANE, NAMES, trails)["features"]
    told = {name: point["properties"][name] for name in ("name", "code", "address", "flight_level")}
    assert told == {
        "name": "1 FL100 0042",
        "code": "0042",
        "address": "3C6444",
        "flight_level": 100,
    }
    assert [place[2] for place in line["geometry"]["coordinates"]] == [3053.0, 3048.0]
    assert other["properties"]["name"] == "2"
    assert not {"code", "address", "flight_level"} & other["properties"].keys()


def test_geojson_places_have_the_longitude_first():
    found = geo_json.positions(
        np.array([52.123456789, 53.0]), np.array([4.0, 5.0]), np.array([math.nan, 1000.04])
    )
    assert found == [[4.0, 52.1234568], [5.0, 53.0, 1000.0]]


def test_lines_are_cut_at_the_antimeridian():
    way = [[179.0, 10.0], [179.5, 10.0], [-179.5, 11.0], [-179.0, 11.0]]
    found = geo_json.line_of(way)
    assert found["type"] == "MultiLineString"
    first, second = found["coordinates"]
    assert first == [[179.0, 10.0], [179.5, 10.0], [180.0, 10.5]]
    assert second == [[-180.0, 10.5], [-179.5, 11.0], [-179.0, 11.0]]
    back = geo_json.line_of(way[::-1])["coordinates"]
    assert back == [part[::-1] for part in (second, first)]
