"""The parameters `world_origin`, `geodetic` and `assumed_height`."""

import math

import pytest

from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.earth import SystemPlane

ORIGIN, PLACE = [52.3, 4.8, 5.0], [53.1, 6.9, 40.0]
ONE = {"sensors": ["north"], "world_origin": ORIGIN, "north.geodetic": PLACE}


def faults_of(given):
    with pytest.raises(ConfigError) as caught:
        resolve(given, SystemPlane)
    return caught.value.faults


def test_a_radar_on_the_earth_has_its_place_and_direction_in_the_plane():
    config = resolve({**ONE, "north.yaw_deg": 0.4}, SystemPlane)
    ((radar,), (layout,)) = config.model.radars, config.inputs
    plane = SystemPlane(ORIGIN)
    assert radar.position == tuple(map(float, plane.to_plane(*PLACE[:2])))
    expected = float(plane.convergence(*PLACE[:2])) + math.radians(0.4)
    assert radar.yaw == pytest.approx(expected, abs=1e-15)
    # North of the origin and to the east, meridians lean to the left by 1.7 degrees.
    assert math.degrees(radar.yaw) == pytest.approx(0.4 + 2.1 * math.sin(math.radians(53)), abs=0.1)
    assert config.plane == plane
    assert layout.site is not None
    assert (layout.height, layout.datum) == (35.0, 5.0)
    assert layout.assumed_height is None


def test_places_need_what_computes_on_the_earth():
    config = resolve({}, SystemPlane)
    assert config.plane is None
    assert all(layout.site is None and layout.datum == 0.0 for layout in config.inputs)
    with pytest.raises(ConfigError, match="world_origin: given, must be empty here"):
        resolve(ONE)
    recorded = resolve(ONE, SystemPlane).values
    lines = scene.differences(recorded, {**recorded, "world_origin": [52.3, 4.9, 5.0]})
    assert lines == ["world_origin: [52.3, 4.8, 5.0] recorded, [52.3, 4.9, 5.0] given"]
    assert scene.differences(recorded, recorded) == []


def test_a_radar_in_the_plane_of_an_origin_measures_over_the_plane():
    config = resolve(
        {"sensors": ["ship"], "world_origin": ORIGIN, "ship.pose": "/ship/odometry"}, SystemPlane
    )
    assert config.inputs[0].site is None
    assert config.inputs[0].datum == 5.0


def test_resolved_places_resolve_again_and_may_be_below_the_ellipsoid():
    given = {**ONE, "sensors": ["north", "radar_1"], "radar_1.geodetic": [52.0, 4.0, 10.0]}
    values = resolve(given, SystemPlane).values
    assert resolve(values, SystemPlane).values == values
    place = [31.5, 35.5, -300.0]
    config = resolve({**ONE, "world_origin": place, "north.geodetic": place}, SystemPlane)
    assert config.inputs[0].height == 0.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"world_origin": []},
            "world_origin: [] given, must be a place on the earth, as north.geodetic is one",
        ),
        (
            {"world_origin": [90.5, 4.8, 0.0]},
            "world_origin: [90.5, 4.8, 0.0] given, must be empty or a latitude from -90 to 90 "
            "degrees, a longitude from -360 to 360 degrees and a height in metres",
        ),
        (
            {"world_origin": [52.3, 4.8]},
            "world_origin: [52.3, 4.8] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [-91.0, 4.8, 0.0]},
            "north.geodetic: [-91.0, 4.8, 0.0] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [53.0, 400.0, 0.0]},
            "north.geodetic: [53.0, 400.0, 0.0] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [61.3, 4.8, 0.0]},
            "north.geodetic: [61.3, 4.8, 0.0] given, is 1001 km from world_origin, must be at most "
            "500 km",
        ),
        (
            {"north.position": [10.0, 0.0]},
            "north.position: given beside geodetic, must be one of the two",
        ),
        ({"north.pose": "/ship/odometry"}, "north.pose: '/ship/odometry' given, must be fixed"),
        (
            {"north.assumed_height": [1.0, 2.0]},
            "north.assumed_height: [1.0, 2.0] given, must be empty or one height",
        ),
        (
            {"north.geodetic": [], "north.assumed_height": [6000.0]},
            "north.assumed_height: given without geodetic, must be empty",
        ),
        (
            {"world_origin": [math.nan, 4.8, 0.0]},
            "world_origin: [nan, 4.8, 0.0] given, must be empty or a latitude",
        ),
    ],
)
def test_resolve_reports_what_is_wrong_with_places(changes, expected):
    faults = faults_of({**ONE, **changes})
    assert len(faults) == 1
    assert faults[0].startswith(expected)
