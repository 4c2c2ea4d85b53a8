import math
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from marker_messages import pose_array
from numpy.testing import assert_allclose, assert_array_equal
from rclpy.serialization import deserialize_message, serialize_message
from samples import STAMP_NS, as_sent, estimates, nothing, of_every_kind, with_heights

from msg_adapters.encoding import stamps
from msg_adapters.targets import tracks
from msg_adapters.targets.tracks import Waypoint

PLANAR = np.ix_([0, 1, 5], [0, 1, 5])
UNKNOWN_AXES = [2, 3, 4]


def made(given, class_id, frame="map"):
    return deserialize_message(tracks.poses_to_cdr(given, class_id, frame), PoseArray)


@of_every_kind
# Frames of several lengths, so that the poses begin at every alignment.
@pytest.mark.parametrize("frame", ["map", "world", "enu/origin"])
def test_to_cdr_equals_the_serialised_objects(found, frame):
    for class_id in range(2):
        expected = pose_array(found, class_id, frame)
        assert made(found, class_id, frame) == as_sent(expected)
        # Nothing is missing at the end, where a reader would not notice.
        written = tracks.poses_to_cdr(found, class_id, frame)
        assert len(written) == len(serialize_message(expected))


def test_to_cdr_takes_one_class_and_faces_where_it_moves():
    given = estimates()
    message = made(given, 0)
    rows = given.state[[0, 2]]
    assert message.header == stamps.header(STAMP_NS, "map")
    found = np.array([[p.position.x, p.position.y, p.position.z] for p in message.poses])
    assert_array_equal(found, np.column_stack([rows[:, 0], rows[:, 2], np.zeros(2)]))
    for pose, row in zip(message.poses, rows, strict=True):
        q = pose.orientation
        speed = np.hypot(row[1], row[3])
        # The x axis turned by the quaternion.
        facing = [1.0 - 2.0 * q.z**2, 2.0 * q.z * q.w]
        assert_allclose(facing, [row[1] / speed, row[3] / speed], atol=1e-12)
        assert_allclose(q.x**2 + q.y**2 + q.z**2 + q.w**2, 1.0)


def one(vx=30.0, vy=40.0, omega=0.02, covariance=None, track=7):
    """Return a single estimate."""
    found = estimates(1)
    return replace(
        found,
        state=np.array([[100.0, vx, -200.0, vy, omega]]),
        covariance=found.covariance if covariance is None else covariance[None],
        track_id=np.array([track]),
    )


def odometry(**changes):
    (message,) = tracks.to_odometry(one(**changes), "map")
    return message


def matrix(part):
    return np.array(part.covariance).reshape(6, 6)


def test_to_odometry_has_pose_and_twist_of_tracks_in_their_order():
    found = replace(estimates(4), track_id=np.array([9, 0, 3, 12]))
    messages = tracks.to_odometry(found, "map")
    assert [m.child_frame_id for m in messages] == ["track_3", "track_9", "track_12"]
    assert [m.pose.pose.position.x for m in messages] == [found.state[k, 0] for k in (2, 0, 3)]
    assert tracks.to_odometry(nothing(), "map") == []
    message = odometry()
    pose, twist = message.pose.pose, message.twist.twist
    assert message.header == stamps.header(STAMP_NS, "map")
    assert (pose.position.x, pose.position.y, pose.position.z) == (100.0, -200.0, 0.0)
    yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    assert yaw == pytest.approx(math.atan2(40.0, 30.0))
    assert (twist.linear.x, twist.linear.y) == (50.0, 0.0)
    assert twist.angular.z == 0.02


def test_to_odometry_covariances_are_those_of_drawn_states():
    # Small against the speed, so that the first order is all there is.
    half = np.random.default_rng(2).normal(size=(5, 5)) * [1.0, 0.1, 1.0, 0.1, 1e-4]
    covariance = half.T @ half
    message = odometry(covariance=covariance)
    mean = one().state[0]
    drawn = np.random.default_rng(3).multivariate_normal(mean, covariance, 200_000)
    x, vx, y, vy, omega = drawn.T
    heading = math.atan2(40.0, 30.0)
    along = vx * math.cos(heading) + vy * math.sin(heading)
    across = -vx * math.sin(heading) + vy * math.cos(heading)

    def close(part, *columns):
        scale = np.sqrt(np.diag(np.cov(columns)))
        error = (matrix(part)[PLANAR] - np.cov(columns)) / np.outer(scale, scale)
        return np.abs(error).max() < 0.02

    assert close(message.pose, x, y, np.arctan2(vy, vx))
    assert close(message.twist, along, across, omega)


@pytest.mark.parametrize("part", ["pose", "twist"])
def test_to_odometry_flags_what_a_planar_track_lacks(part):
    found = matrix(getattr(odometry(), part))
    assert np.diag(found)[UNKNOWN_AXES].tolist() == [tracks.UNKNOWN_VARIANCE] * 3
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
    assert np.linalg.eigvalsh(found).min() >= 0.0


@pytest.mark.parametrize("speed", [0.0, 1e-200, 1e-3])
def test_to_odometry_of_a_target_at_rest_has_no_direction(speed):
    message = odometry(vx=speed, vy=0.0)
    found = matrix(message.pose)
    assert np.isfinite(found).all()
    assert found[5, 5] == pytest.approx(math.pi**2 / 3.0)
    assert not found[5, :5].any()


def test_to_path_keeps_the_places_with_their_stamps():
    way = [
        Waypoint(STAMP_NS + k * 10**9, np.array([float(k), 3.0, 10.0 * k, 0.0, 0.0]))
        for k in range(3)
    ]
    path = tracks.to_path(way, "map")
    path = deserialize_message(serialize_message(path), type(path))
    assert path.header == stamps.header(STAMP_NS + 2 * 10**9, "map")
    assert [p.header for p in path.poses] == [stamps.header(w.stamp_ns, "map") for w in way]
    places = [(p.pose.position.x, p.pose.position.y) for p in path.poses]
    assert places == [(0.0, 0.0), (1.0, 10.0), (2.0, 20.0)]
    assert path.poses[0].pose.orientation.w == 1.0


@pytest.mark.parametrize(
    ("heights", "shown"),
    [
        ([math.nan, 3048.0, math.nan, 3078.0], [3048.0, 3048.0, 3048.0, 3078.0]),
        ([math.nan] * 4, [0.0] * 4),
    ],
)
def test_to_path_is_at_the_heights_of_the_track(heights, shown):
    way = [Waypoint(STAMP_NS + k, np.zeros(5), height) for k, height in enumerate(heights)]
    path = tracks.to_path(way, "map")
    assert [p.pose.position.z for p in path.poses] == shown


def test_heights_are_in_the_pose_and_the_twist_where_they_are_known():
    plain = replace(estimates(2), track_id=np.array([1, 2]))
    known = with_heights(plain, [[3048.0, -7.5], [np.nan, np.nan]])
    (first, second), (before, _) = (tracks.to_odometry(each, "map") for each in (known, plain))
    assert (first.pose.pose.position.z, first.twist.twist.linear.z) == (3048.0, -7.5)
    assert (first.pose.covariance[14], first.twist.covariance[14]) == (60.0, 1.5)
    assert (second.pose.pose.position.z, second.twist.twist.linear.z) == (0.0, 0.0)
    assert second.pose.covariance[14] == before.pose.covariance[14]
    assert (
        np.delete(first.pose.covariance, 14).tolist()
        == np.delete(before.pose.covariance, 14).tolist()
    )
