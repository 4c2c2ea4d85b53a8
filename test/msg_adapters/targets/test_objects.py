"""Objects of driving stacks, in messages that are built after their public definitions."""

import math
import uuid
from dataclasses import replace

import message_types as types
import numpy as np
import pytest
from numpy.testing import assert_allclose
from samples import STAMP_NS, estimates, nothing, with_heights

from msg_adapters.encoding import names, stamps
from msg_adapters.targets import objects

AUTOWARE, NAV2, DERIVED = "autoware_perception_msgs", "nav2_dynamic_msgs", "derived_object_msgs"
CLASS = {
    names.TRACKED_OBJECTS: types.TrackedObjects,
    f"{AUTOWARE}/msg/TrackedObject": types.TrackedObject,
    f"{AUTOWARE}/msg/ObjectClassification": types.ObjectClassification,
    names.OBSTACLES: types.ObstacleArray,
    f"{NAV2}/msg/Obstacle": types.Obstacle,
    names.DERIVED_OBJECTS: types.DerivedObjectArray,
    f"{DERIVED}/msg/Object": types.DerivedObject,
}.__getitem__
RUN, KINDS = uuid.UUID(int=1), ("car", "submarine")


def autoware(given):
    return objects.to_tracked_objects(given, "map", KINDS, RUN, CLASS)


def obstacles(given):
    return objects.to_obstacles(given, "map", RUN, CLASS)


def derived(given):
    return objects.to_derived_objects(given, "map", KINDS, CLASS)


@pytest.mark.parametrize("encode", [autoware, obstacles, derived])
@pytest.mark.parametrize("given", [estimates(), nothing()])
def test_messages_have_stamp_frame_and_one_entry_for_each_track(encode, given):
    given = replace(given, track_id=np.arange(1, len(given) + 1))
    message = encode(given)
    assert (message.header.frame_id, stamps.to_ns(message.header.stamp)) == ("map", STAMP_NS)
    assert len(getattr(message, "objects", getattr(message, "obstacles", None))) == len(given)


def test_autoware_has_the_twist_along_the_pose_with_its_covariance():
    given = estimates()
    for row, one in enumerate(autoware(given).objects):
        x, vx, y, vy, omega = given.state[row].tolist()
        pose, twist = one.kinematics.pose_with_covariance, one.kinematics.twist_with_covariance
        assert (pose.pose.position.x, pose.pose.position.y) == (x, y)
        yaw = 2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w)
        speed = twist.twist.linear.x
        assert (speed * math.cos(yaw), speed * math.sin(yaw)) == pytest.approx((vx, vy))
        assert twist.twist.angular.z == omega
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        expected = turn @ given.velocity_covariance[row] @ turn.T
        assert_allclose(np.reshape(twist.covariance, (6, 6))[:2, :2], expected, atol=1e-9)
        spread = np.reshape(pose.covariance, (6, 6))[:2, :2]
        assert_allclose(spread, given.position_covariance[row])


def test_classes_have_the_numbers_of_their_names():
    given = estimates()
    found = autoware(given).objects[0]
    assert [kind.label for kind in found.classification] == [1, 0]
    shares = [kind.probability for kind in found.classification]
    assert shares == given.class_probability[0].tolist()
    given = replace(given, track_id=np.arange(1, len(given) + 1))
    for row, one in enumerate(derived(given).objects):
        known = given.class_id[row] == 0
        assert (one.classification, one.object_classified) == ((6, True) if known else (0, False))


def test_derived_objects_leave_out_what_has_no_number():
    given = replace(estimates(), track_id=np.array([0, 5, 6]))
    assert [one.id for one in derived(given).objects] == [5, 6]


def test_obstacles_have_covariances_where_their_definition_has():
    given = with_heights(estimates(2), [[120.0, 1.0], [math.nan, math.nan]])
    for row, one in enumerate(obstacles(given).obstacles):
        position, velocity = (
            np.reshape(getattr(one, f"{name}_covariance"), (3, 3))
            for name in ("position", "velocity")
        )
        assert_allclose(position[:2, :2], given.position_covariance[row])
        assert_allclose(velocity[:2, :2], given.velocity_covariance[row])
        assert (position[2, 2], velocity[2, 2]) == ((60.0, 1.5) if row == 0 else (1e6, 1e6))

    def early(name):
        return types.EarlyObstacle if name == f"{NAV2}/msg/Obstacle" else CLASS(name)

    found = objects.to_obstacles(given, "map", RUN, early).obstacles
    assert [one.position.z for one in found] == [120.0, 0.0]


def test_autoware_has_the_variance_of_a_known_height():
    given = with_heights(estimates(2), [[120.0, 1.0], [math.nan, math.nan]])
    found = [one.kinematics for one in autoware(given).objects]
    for one, expected in zip(found, ((60.0, 1.5), (1e6, 1e6)), strict=True):
        pose, twist = one.pose_with_covariance, one.twist_with_covariance
        assert (pose.covariance[14], twist.covariance[14]) == expected


def test_obstacles_keep_their_identifiers_within_a_run():
    given = replace(estimates(), track_id=np.array([7, 8, 9]))
    now, later = (
        [bytes(one.uuid.uuid) for one in obstacles(each).obstacles]
        for each in (given, replace(given, stamp_ns=STAMP_NS + 1))
    )
    assert now == later
    assert len(set(now)) == 3


@pytest.mark.parametrize(
    ("package", "encode"),
    [
        (AUTOWARE, lambda given: objects.to_tracked_objects(given, "map", KINDS, RUN)),
        (NAV2, lambda given: objects.to_obstacles(given, "map", RUN)),
        (DERIVED, lambda given: objects.to_derived_objects(given, "map", KINDS)),
    ],
)
def test_messages_fit_the_installed_ones(package, encode):
    pytest.importorskip(package)
    encode(estimates())
