from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from reference import resolve
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud, stamps
from msg_adapters.outgoing import map_layers
from msg_adapters.outgoing.map_layers import Mounting
from msg_adapters.targets.tracks import UNSEEN_SCANS, Trails
from phd_jdtc_ros.core.types import Detections, Estimates, Scan
from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster

SHOWN = ClutterRaster((-1500.0, 300.0), 50.0, np.array([[0.0, 0.01, 0.1], [1.0, 1000.0, 1e5]]))
NAMES = ("x", "y", "z", "amplitude", "radar_index")
FIRST, SECOND = resolve({}).model.radars
# Half a revolution and a quarter, so that axes cannot be confused.
RADARS = (replace(FIRST, yaw=np.pi), replace(SECOND, position=(0.0, 50.0), yaw=np.pi / 2.0))
STAMP_NS = 1_700_000_000_123_456_789
HITS = Detections(np.array([[100.0, 0.0], [200.0, np.pi / 2.0]]), np.array([4.0, 30.0]))
SILENT = Detections(np.zeros((0, 2)), np.zeros(0))
STORE = get_typestore(Stores.ROS2_JAZZY)


def test_values_are_twenty_to_a_factor_of_ten():
    message = map_layers.clutter_to_msg(SHOWN, 1_500_000_000, "map")
    assert list(message.data) == [0, 0, 20, 40, 100, 100]
    assert (message.info.width, message.info.height, message.info.resolution) == (3, 2, 50.0)
    assert message.header.frame_id == "map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    origin = message.info.origin
    assert (origin.position.x, origin.position.y, origin.orientation.w) == (-1500.0, 300.0, 1.0)


def test_a_recorded_message_is_the_picture_again():
    data = interfaces.encode(map_layers.clutter_to_msg(SHOWN, 1, "map"))
    found = map_layers.clutter_from_msg(interfaces.decode(data, names.GRID))
    assert (found.corner, found.cell) == (SHOWN.corner, SHOWN.cell)
    np.testing.assert_allclose(found.density, [[0.0, 0.0, 0.1], [1.0, 1000.0, 1000.0]])


def _smaller(message):
    message.info.width = 2


def _empty(message):
    message.info.width, message.data = 0, []


def _nowhere(message):
    message.info.origin.position.x = float("nan")


def _flat(message):
    message.info.resolution = 0.0


@pytest.mark.parametrize(
    ("change", "reason"),
    [(_smaller, "schema"), (_empty, "schema"), (_nowhere, "not_finite"), (_flat, "not_finite")],
)
def test_a_message_that_is_no_picture_is_refused(change, reason):
    message = map_layers.clutter_to_msg(SHOWN, 1, "map")
    change(message)
    with pytest.raises(RejectedMessageError) as caught:
        map_layers.clutter_from_msg(message)
    assert caught.value.reason == reason


def cloud_of(*reports):
    data = map_layers.detections_to_cdr(Scan(STAMP_NS, reports), RADARS, "site")
    return deserialize_message(data, PointCloud2)


def columns(cloud):
    kinds = dict.fromkeys(NAMES[:-1], point_cloud.FLOATS)
    return point_cloud.decode(cloud, {**kinds, NAMES[-1]: point_cloud.UNSIGNED})


def test_to_cdr_has_all_radars_detections_in_the_world_frame():
    cloud = cloud_of(HITS, Detections(np.array([[10.0, 0.0]]), np.array([7.0])))
    found = columns(cloud)
    assert (cloud.header.frame_id, stamps.to_ns(cloud.header.stamp)) == ("site", STAMP_NS)
    assert tuple(field.name for field in cloud.fields) == NAMES
    np.testing.assert_allclose(found["x"], [900.0, 1000.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(found["y"], [0.0, -200.0, 60.0], atol=1e-4)
    np.testing.assert_array_equal(found["amplitude"], [4.0, 30.0, 7.0])
    np.testing.assert_array_equal(found["radar_index"], [0, 0, 1])


def test_to_cdr_has_zeros_for_unknown_amplitudes_and_known_heights():
    found = columns(cloud_of(HITS, Detections(np.array([[10.0, 0.0]]), None)))
    np.testing.assert_array_equal(found["amplitude"], [4.0, 30.0, 0.0])
    high = replace(HITS, height=np.array([3048.0, np.nan]))
    assert columns(cloud_of(high, HITS))["z"].tolist() == [3048.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("reports", [(None, None), (SILENT, None), (SILENT, SILENT)])
def test_to_cdr_of_nothing_is_an_empty_cloud(reports):
    cloud = cloud_of(*reports)
    assert (cloud.width, cloud.height) == (0, 1)
    assert tuple(field.name for field in cloud.fields) == NAMES


def test_to_cdr_leaves_out_a_radar_that_did_not_report():
    assert columns(cloud_of(None, HITS))["radar_index"].tolist() == [1, 1]


def found(scan, **x_of_track):
    """Return a scan's estimates: track number and x, as ``t3=10.0``."""
    size = len(x_of_track)
    state = np.zeros((size, 5))
    state[:, 0] = list(x_of_track.values())
    return Estimates(
        stamp_ns=scan,
        lag=0,
        state=state,
        covariance=np.zeros((size, 5, 5)),
        weight=np.ones(size),
        class_probability=np.ones((size, 1)),
        class_id=np.zeros(size),
        track_id=np.array([int(name[1:]) for name in x_of_track], dtype=int),
    )


def shape(trails):
    return [[(point.stamp_ns, point.state[0]) for point in trail] for trail in trails.values()]


def test_of_returns_the_latest_places_of_tracks():
    trails = Trails(5)
    assert shape(trails.of(found(1, t9=90.0, t3=30.0))) == [[(1, 30.0)], [(1, 90.0)]]
    assert shape(trails.of(found(2, t9=91.0))) == [[(1, 90.0), (2, 91.0)]]
    assert Trails(5).of(found(1, t0=1.0)) == {}
    trails = Trails(2)
    for scan in range(4):
        latest = trails.of(found(scan, t1=float(scan)))
    assert shape(latest) == [[(2, 2.0), (3, 3.0)]]
    trails, scan = Trails(5), found(1, t1=1.0)
    trails.of(scan)
    assert shape(trails.of(scan)) == [[(1, 1.0)]]


def test_of_forgets_after_a_long_gap_and_clear():
    trails = Trails(100)
    trails.of(found(0, t1=0.0))
    for scan in range(UNSEEN_SCANS):
        trails.of(found(1 + scan))
    assert len(trails.of(found(50, t1=1.0))[1]) == 2
    for scan in range(UNSEEN_SCANS + 1):
        trails.of(found(51 + scan))
    assert len(trails.of(found(99, t1=1.0))[1]) == 1
    trails = Trails(5)
    trails.of(found(1, t1=1.0))
    trails.clear()
    assert shape(trails.of(replace(found(2, t1=2.0), stamp_ns=7))) == [[(7, 2.0)]]


def decoded(mountings, world="map"):
    data = map_layers.frames_to_cdr(mountings, STAMP_NS, world)
    return STORE.deserialize_cdr(data, names.TRANSFORMS).transforms


def test_to_cdr_places_every_frame_in_the_world():
    mast = Mounting("mast", (1000.0, -20.5), 2.0)
    first, second = decoded([mast, Mounting("radar_number_two", (0.0, 3.0), 0.0)], "site")
    assert (first.header.frame_id, first.child_frame_id) == ("site", "mast")
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == divmod(STAMP_NS, 10**9)
    where = first.transform.translation
    assert (where.x, where.y, where.z) == (1000.0, -20.5, 0.0)
    assert second.child_frame_id == "radar_number_two"
    assert second.transform.rotation.w == 1.0


@pytest.mark.parametrize("yaw", [0.0, 1.0, np.pi, -3.0])
def test_to_cdr_turns_a_frame_counter_clockwise(yaw):
    ((transform),) = decoded([Mounting("mast", (0.0, 0.0), yaw)])
    q = transform.transform.rotation
    # The x axis of the radar, in the world frame.
    ahead = (q.w**2 - q.z**2, 2.0 * q.w * q.z)
    assert (q.x, q.y) == (0.0, 0.0)
    np.testing.assert_allclose(ahead, (np.cos(yaw), np.sin(yaw)), atol=1e-12)


def test_to_cdr_leaves_out_a_radar_in_the_world_frame_itself():
    assert decoded([Mounting("map", (0.0, 0.0), 0.0)]) == []
