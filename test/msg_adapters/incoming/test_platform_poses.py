import math

import pytest
from geometry_msgs.msg import PoseStamped, Quaternion
from nav_msgs.msg import Odometry

from msg_adapters.encoding import interfaces, stamps
from msg_adapters.encoding.errors import RejectedMessageError
from msg_adapters.incoming import platform_poses
from phd_jdtc_ros.core.types import Pose

STAMP = 1_700_000_000_123_456_789


def odometry(**orientation):
    message = Odometry(header=stamps.header(STAMP, "map"))
    message.pose.pose.orientation = Quaternion(**orientation)
    return message


@pytest.mark.parametrize("kind", list(platform_poses.TYPES))
def test_a_pose_is_read_as_it_was_written(kind):
    data = platform_poses.to_cdr(Pose((12.5, -7.25), 2.0), STAMP, "map", kind)
    stamp_ns, pose = platform_poses.from_cdr(data, kind, "map")
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
    assert platform_poses.from_msg(odometry(**turned), "map")[1].yaw == pytest.approx(yaw)


@pytest.mark.parametrize("axis", "xyzw")
@pytest.mark.parametrize("value", [0.0, math.nan, 1e300, -1e300, 1e160, 1.7e308, math.inf])
def test_an_orientation_that_is_absurd_has_no_yaw(axis, value):
    message = odometry(**{"z": value, "w": value, axis: value})
    assert math.isnan(platform_poses.from_msg(message, "map")[1].yaw)


def test_poses_in_other_frames_and_other_messages_are_refused():
    with pytest.raises(RejectedMessageError, match="'map', must be the world frame, 'enu'") as why:
        platform_poses.from_msg(odometry(), "enu")
    assert why.value.reason == "frame"
    data = interfaces.encode(stamps.header(STAMP, "map"))
    with pytest.raises(RejectedMessageError):
        platform_poses.from_cdr(data, "odometry", "map")


@pytest.mark.parametrize(
    ("x", "reason"), [(math.inf, "not_finite"), (math.nan, "not_finite"), (1e300, "range")]
)
def test_a_position_that_is_none_is_refused(x, reason):
    message = PoseStamped(header=stamps.header(STAMP, "map"))
    message.pose.position.x = x
    with pytest.raises(RejectedMessageError) as why:
        platform_poses.from_msg(message, "map")
    assert why.value.reason == reason
