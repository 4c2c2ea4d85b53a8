"""Poses of a radar's platform: ``nav_msgs/Odometry`` or ``geometry_msgs/PoseStamped``."""

from __future__ import annotations

import math
from typing import Any

from geometry_msgs.msg import Point, PoseStamped, Quaternion
from nav_msgs.msg import Odometry

from phd_jdtc_ros.core.types import Pose

from ..encoding import interfaces, names, stamps
from ..encoding.errors import RejectedMessageError, quote

# Types of pose messages by their configured name.
TYPES = {"odometry": names.ODOMETRY, "pose_stamped": names.POSE_STAMPED}
# Accepted norms of an orientation's quaternion; an uninitialised message has the norm 0.
LEAST_NORM, LARGEST_NORM = 0.5, 2.0
# Largest coordinate, metres; beyond it, single precision no longer resolves a metre.
FARTHEST = 1e7
# Places of the variances of x, y and yaw in a twist's covariance of 6 x 6.
TWIST_VARIANCES = 0, 7, 35
# Largest rate of a platform, m/s and rad/s.
FASTEST = 1e3


def from_msg(message: Odometry | PoseStamped, world_frame: str) -> tuple[int, Pose]:
    """Return the stamp and the pose of a message in the world frame.

    The yaw is NaN if the orientation is not a unit quaternion, as in an uninitialised message. Only
    odometry has a twist; see `_twist`.

    Raise `RejectedMessageError`: ``frame`` if it is in another frame; ``schema`` if its stamp is
    invalid; ``not_finite`` or ``range`` if its position is not finite or farther away than
    `FARTHEST`.
    """
    frame = message.header.frame_id
    if frame != world_frame:
        raise RejectedMessageError(
            "frame", f"frame_id {quote(frame)}, must be the world frame, {world_frame!r}"
        )
    stamp_ns = stamps.of_input(message.header)
    has_twist = isinstance(message, Odometry)
    pose = message.pose.pose if has_twist else message.pose
    position = float(pose.position.x), float(pose.position.y)
    if not all(map(math.isfinite, position)):
        raise RejectedMessageError("not_finite", f"position {position}, must be finite")
    if max(map(abs, position)) > FARTHEST:
        raise RejectedMessageError(
            "range", f"position {position}, must be within {FARTHEST:g} m of the map's origin"
        )
    twist = _twist(message) if has_twist else None
    return stamp_ns, Pose(position, _yaw(pose.orientation), twist=twist)


def from_cdr(data: bytes, kind: str, world_frame: str) -> tuple[int, Pose]:
    """Decode a recorded message of a kind of `TYPES` as `from_msg` does."""
    return from_msg(interfaces.decode(data, TYPES[kind]), world_frame)


def to_cdr(pose: Pose, stamp_ns: int, world_frame: str, kind: str, child_frame: str = "") -> bytes:
    """Serialise a message of a kind of `TYPES`; an odometry's velocity is 0."""
    header, (x, y), half = stamps.header(stamp_ns, world_frame), pose.position, 0.5 * pose.yaw
    message: Any = PoseStamped(header=header)
    own = message.pose
    if kind == "odometry":
        message = Odometry(header=header, child_frame_id=child_frame)
        own = message.pose.pose
    own.position = Point(x=float(x), y=float(y), z=0.0)
    own.orientation = Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
    return interfaces.encode(message)


def _twist(message: Odometry) -> tuple[float, float, float] | None:
    """Return an odometry's velocity ahead and to the left, m/s, and its yaw rate, rad/s, or None.

    It is unknown if a number is not finite or absurd, or if a variance is negative, as drivers mark
    unknown quantities. A twist of zeros with a covariance of zeros is one that was never set. If
    that of a platform at rest looks the same, the poses show the rest.
    """
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    twist = float(linear.x), float(linear.y), float(angular.z)
    variances = [float(message.twist.covariance[index]) for index in TWIST_VARIANCES]
    if not all(abs(rate) <= FASTEST for rate in twist) or min(variances) < 0.0:  # also for NaN
        return None
    return twist if any(twist) or any(variances) else None


def _yaw(turn: Quaternion) -> float:
    """Return the direction of the x axis over ground, radians; NaN for an invalid quaternion."""
    # `hypot` avoids the squares of large finite numbers, which overflow with an error.
    norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if not LEAST_NORM <= norm <= LARGEST_NORM:  # also true for NaN
        return math.nan
    ahead = turn.w**2 + turn.x**2 - turn.y**2 - turn.z**2
    left = 2.0 * (turn.x * turn.y + turn.w * turn.z)
    return math.atan2(left, ahead)
