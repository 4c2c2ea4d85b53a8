"""Plots of radars that stand on the round earth or move."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Quaternion
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from numpy.testing import assert_allclose, assert_array_equal
from pyproj import Geod
from samples import FRAME, STAMP_NS, cloud, radar
from sensor_msgs.msg import PointField
from topocentric import seen_from

from msg_adapters.encoding import RejectedMessageError, interfaces, stamps
from msg_adapters.incoming import detections as adapter
from msg_adapters.incoming import moving_radars, radar_scan
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.sensors.site import HeightProjection, Site
from phd_jdtc_ros.core.types import Detections, Pose
from phd_jdtc_ros.earth import SystemPlane

ORIGIN, PLACE = (52.3, 4.8, 5.0), (53.1, 6.9, 40.0)
PLANE = SystemPlane(ORIGIN)
SITE = Site(PLACE, PLANE)
TOPOCENTRIC = seen_from(*PLACE)
F8 = PointField.FLOAT64
NAN = np.nan
ANY = st.floats(width=32, allow_nan=True, allow_infinity=True)
LAYOUTS = [
    (("range", "azimuth", "height"), {}),
    (("range", "azimuth", "elevation"), {"height_field": "", "elevation_field": "elevation"}),
    (("range", "azimuth", "height"), {"assumed_height": 9000.0}),
]
STAMP = 1_700_000_000_123_456_789


def sited(**changes):
    """Return the input of a radar on the earth, whose clouds have heights and compass degrees."""
    usual = {
        "amplitude_field": "",
        "compass": True,
        "azimuth_in_degrees": True,
        "height_field": "height",
        "site": SITE,
        "datum": ORIGIN[2],
        "max_range": 450e3,
    }
    return radar(**{**usual, **changes})


def read(points, names=("range", "azimuth", "height"), **changes):
    return adapter.from_msg(cloud([(name, F8) for name in names], points), sited(**changes))


def around(distance, height):
    """Return where targets in 24 directions are in the plane, (24, 2), and their plots."""
    bearing = np.arange(0.0, 360.0, 15.0)
    count = len(bearing)
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(
        np.full(count, PLACE[1]), np.full(count, PLACE[0]), bearing, np.full(count, distance)
    )
    east, north, up = TOPOCENTRIC.transform(longitude, latitude, np.full(count, height))
    slant = np.sqrt(east**2 + north**2 + up**2)
    compass = np.degrees(np.arctan2(east, north)) % 360.0
    places = np.stack(PLANE.to_plane(latitude, longitude), axis=1)
    return places, slant, compass, np.degrees(np.arcsin(up / slant))


def assert_at(places, report):
    """Compare where detections are in the plane."""
    distance, azimuth = report.detections.measurement.T
    bearing = azimuth + SITE.yaw
    apart = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)
    assert_allclose(SITE.position + apart, places, rtol=0.0, atol=0.01)


@pytest.mark.parametrize("distance", [20e3, 150e3, 400e3])
@pytest.mark.parametrize("height", [-300.0, 1000.0, 11e3])
def test_plots_with_heights_are_where_the_targets_are(distance, height):
    places, slant, compass, _ = around(distance, height)
    report = read([(*plot, height) for plot in zip(slant, compass, strict=True)])
    assert not report.dropped
    assert not report.anomalies
    assert_at(places, report)
    # Heights are above the world's zero, that of the origin.
    assert_allclose(report.detections.height, height - ORIGIN[2])


def test_plots_with_elevations_are_where_the_targets_are():
    places, slant, compass, elevation = around(150e3, 6000.0)
    names = ("range", "azimuth", "elevation")
    plots = [
        (distance, math.radians(90.0 - azimuth), math.radians(up))
        for distance, azimuth, up in zip(slant, compass, elevation, strict=True)
    ]
    report = read(
        plots,
        names,
        height_field="",
        elevation_field="elevation",
        compass=False,
        azimuth_in_degrees=False,
    )
    assert_at(places, report)


def test_an_unknown_height_is_the_antennas_or_the_assumed_one():
    places, slant, compass, _ = around(80e3, PLACE[2])
    report = read([(*plot, NAN) for plot in zip(slant, compass, strict=True)])
    assert_at(places, report)
    assert report.anomalies == {"heights_unknown": 24}
    (text,) = anomalies.of(sited(), report.anomalies)
    assert "the antenna's height is assumed, set radar_1.assumed_height" in text
    places, slant, compass, _ = around(80e3, 6000.0)
    plots = list(zip(slant, compass, strict=True))
    report = read(plots, ("range", "azimuth"), height_field="", assumed_height=6000.0)
    assert_at(places, report)
    assert report.detections.height is None


@pytest.mark.parametrize(
    "layout", [{}, {"assumed_height": 6000.0}, {"site": None, "position": (0.0, 0.0, 30.0)}]
)
@pytest.mark.parametrize("height", [1200.0, 11000.0])
def test_a_plot_without_a_height_is_read_again_as_with_it(layout, height):
    distance = np.array([15e3, 60e3, 200e3, 400e3])
    points = [(slant, 70.0 * i, height) for i, slant in enumerate(distance)]
    known = read(points, **layout).detections.measurement
    unknown = read([(*point[:2], NAN) for point in points], **layout).detections.measurement
    assert np.abs(known - unknown)[:, 0].max() > 10.0
    own = sited(**layout)
    again = HeightProjection(own.height, own.datum, own.site, own.assumed_height).at(
        *(unknown, np.full(4, NAN), np.full(4, height - own.datum))
    )
    assert_allclose(again, known, rtol=0.0, atol=1e-3)


def test_a_plot_with_a_false_height_is_read_again_as_with_the_true_one():
    points = [(slant, 40.0, 9000.0) for slant in (15e3, 60e3, 200e3, 400e3)]
    true = read(points).detections
    false = read([(*point[:2], 2000.0) for point in points]).detections
    own = sited()
    reading = HeightProjection(own.height, own.datum, own.site, own.assumed_height)
    again = reading.at(false.measurement, false.height, true.height)
    assert_allclose(again, true.measurement, rtol=0.0, atol=1e-3)


def test_an_assumed_height_near_the_radar_is_below_30_degrees():
    found = read([(5e3, 90.0)], ("range", "azimuth"), height_field="", assumed_height=6000.0)
    ((ground, _),) = found.detections.measurement
    assert ground == pytest.approx(5e3 * math.cos(math.radians(30.0)), rel=1e-3)
    report = read([(0.0, 10.0, NAN)])
    assert_allclose(report.detections.measurement[:, 0], 0.0, atol=0.01)


def test_impossible_points_are_dropped_by_reason():
    report = read(
        [
            (9e3, 10.0, 12e3),  # Higher than it is far away
            (90e3, 10.0, 40e3),  # Nothing flies so high
            (90e3, 10.0, 1e300),
            (460e3, 10.0, 9e3),  # Beyond the maximum range
            (1e300, 10.0, 9e3),
            (-90e3, 10.0, 9e3),
            (NAN, 10.0, 9e3),
            (90e3, NAN, 9e3),
            (90e3, 10.0, 9e3),
        ]
    )
    assert report.dropped == {"height": 3, "range": 3, "not_finite": 2}
    assert len(report.detections) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"height_field": ""},
        {"height_field": "", "assumed_height": 6000.0},
        {"assumed_height": 9000.0},
    ],
)
def test_clouds_of_a_sited_radar_are_read_back(changes):
    rng = np.random.default_rng(3)
    ground = np.append(rng.uniform(0.0, 400e3, 200), [300.0, 8e3, 11e3])
    azimuth = rng.uniform(-np.pi, np.pi, len(ground))
    height = None
    if changes.get("height_field", "height"):
        height = rng.uniform(-300.0, 13e3, len(ground))
        height[::5] = np.nan
    sent = Detections(np.stack([ground, azimuth], axis=1), None, height=height)
    layout = sited(**changes)
    back = adapter.from_msg(adapter.to_msg(sent, STAMP_NS, FRAME, layout), layout).detections
    assert len(back) == len(sent)
    # The cloud has single precision: 0.02 m of range and 1e-5 degrees; near the zenith it is more.
    assert_allclose(back.measurement[:, 0], ground, rtol=0.0, atol=2.0)
    apart = (back.measurement[:, 1] - azimuth + np.pi) % (2.0 * np.pi) - np.pi
    assert_allclose(apart, 0.0, rtol=0.0, atol=1e-6)
    far = ground > 20e3
    assert_allclose(back.measurement[far, 0], ground[far], rtol=0.0, atol=0.05)
    if height is not None:
        assert_allclose(back.height, height, rtol=0.0, atol=1e-3)


def test_scans_of_a_sited_radar_are_read_back():
    rng = np.random.default_rng(4)
    ground = rng.uniform(0.0, 300e3, 50)
    azimuth = rng.uniform(-np.pi, np.pi, 50)
    layout = sited(message="radar_scan", height_field="", compass=False, azimuth_in_degrees=False)
    sent = Detections(np.stack([ground, azimuth], axis=1), None)
    back = radar_scan.from_cdr(radar_scan.to_cdr(sent, STAMP_NS, layout), layout).detections
    assert_allclose(back.measurement[:, 0], ground, rtol=0.0, atol=0.05)
    assert_allclose(back.measurement[:, 1], azimuth, rtol=0.0, atol=1e-6)


def test_points_are_read_alike_alone_and_together():
    # Live and offline cut reports differently.
    rng = np.random.default_rng(5)
    plots = [
        (distance, azimuth, height)
        for distance, azimuth, height in zip(
            rng.uniform(15e3, 400e3, 30),
            rng.uniform(0.0, 360.0, 30),
            rng.uniform(0.0, 12e3, 30),
            strict=True,
        )
    ]
    together = read(plots).detections.measurement
    alone = np.concatenate([read([plot]).detections.measurement for plot in plots])
    assert_array_equal(alone, together)


@given(points=st.lists(st.tuples(ANY, ANY, ANY), max_size=8), layout=st.sampled_from(LAYOUTS))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_whatever_numbers_a_cloud_has_its_detections_are_possible(points, layout):
    names, changes = layout
    report = read(points, names, **changes)
    found = report.detections.measurement
    assert np.isfinite(found).all()
    assert ((found[:, 0] >= 0.0) & (found[:, 0] <= 450e3)).all()
    assert (np.abs(found[:, 1]) <= np.pi).all()
    repeated = report.anomalies["detections_repeated"]
    assert len(found) + sum(report.dropped.values()) + repeated == len(points)


def odometry(**orientation):
    message = Odometry(header=stamps.header(STAMP, "map"))
    message.pose.pose.orientation = Quaternion(**orientation)
    return message


@pytest.mark.parametrize("kind", list(moving_radars.POSE_TYPES))
def test_a_pose_is_read_as_it_was_written(kind):
    data = moving_radars.pose_to_cdr(Pose((12.5, -7.25), 2.0), STAMP, "map", kind)
    stamp_ns, pose = moving_radars.pose_from_cdr(data, kind, "map")
    assert stamp_ns == STAMP
    assert pose.position == (12.5, -7.25)
    assert pose.yaw == pytest.approx(2.0)


def test_a_yaw_is_that_of_the_x_axis_whatever_the_roll():
    roll, yaw = 0.3, -1.2
    turned = {
        "x": math.sin(roll / 2) * math.cos(yaw / 2),
        "y": math.sin(roll / 2) * math.sin(yaw / 2),
        "z": math.cos(roll / 2) * math.sin(yaw / 2),
        "w": math.cos(roll / 2) * math.cos(yaw / 2),
    }
    assert moving_radars.pose_from_msg(odometry(**turned), "map")[1].yaw == pytest.approx(yaw)


@pytest.mark.parametrize("axis", "xyzw")
@pytest.mark.parametrize("value", [0.0, math.nan, 1e300, -1e300, 1e160, 1.7e308, math.inf])
def test_an_orientation_that_is_absurd_has_no_yaw(axis, value):
    message = odometry(**{"z": value, "w": value, axis: value})
    assert math.isnan(moving_radars.pose_from_msg(message, "map")[1].yaw)


@pytest.mark.parametrize(
    ("linear", "variance", "twist"),
    [
        ((14.0, -0.5), 0.0, (14.0, -0.5, 0.0, 0.0, 0.0, 0.2)),
        ((14.0, -0.5), 0.01, (14.0, -0.5, 0.0, 0.0, 0.0, 0.2)),
        ((14.0, -0.5), -1.0, None),
        ((math.nan, 0.0), 0.01, None),
        ((1e300, 0.0), 0.01, None),
    ],
)
def test_the_velocity_of_an_odometry_is_known_unless_marked_otherwise(linear, variance, twist):
    message = odometry()
    message.twist.twist.linear.x, message.twist.twist.linear.y = linear
    message.twist.twist.angular.z = 0.2
    message.twist.covariance[0] = variance
    assert moving_radars.pose_from_msg(message, "map")[1].twist == twist


@pytest.mark.parametrize(("variance", "twist"), [(0.0, None), (0.01, (0.0,) * 6)])
def test_a_velocity_of_zero_is_measured_if_it_has_a_covariance(variance, twist):
    message = odometry()
    message.twist.covariance[35] = variance
    assert moving_radars.pose_from_msg(message, "map")[1].twist == twist


def test_poses_in_other_frames_and_other_messages_are_refused():
    with pytest.raises(RejectedMessageError, match="'map', must be the world frame, 'enu'") as why:
        moving_radars.pose_from_msg(odometry(), "enu")
    assert why.value.reason == "frame"
    data = interfaces.encode(stamps.header(STAMP, "map"))
    with pytest.raises(RejectedMessageError):
        moving_radars.pose_from_cdr(data, "odometry", "map")


@pytest.mark.parametrize(
    ("x", "reason"), [(math.inf, "not_finite"), (math.nan, "not_finite"), (1e300, "range")]
)
def test_a_position_that_is_none_is_refused(x, reason):
    message = PoseStamped(header=stamps.header(STAMP, "map"))
    message.pose.position.x = x
    with pytest.raises(RejectedMessageError) as why:
        moving_radars.pose_from_msg(message, "map")
    assert why.value.reason == reason
