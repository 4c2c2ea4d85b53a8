"""Where the platforms of moving radars are: odometry, poses or transforms, as poses by radar.

Transforms are ``tf2_msgs/TFMessage``, as on ``/tf`` and ``/tf_static``. tf2_msgs is not part of
every installation, so the message is read from its bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Point, PoseStamped, Quaternion
from nav_msgs.msg import Odometry

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS, TF
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.transforms import (
    Placement,
    Transform,
    TransformBuffer,
    attitude,
    of_angles,
)
from phd_jdtc_ros.core.types import LEVEL, Pose

from ..encoding import RejectedMessageError, interfaces, names, quote, stamps

# Types of pose messages by their configured name.
POSE_TYPES = {"odometry": names.ODOMETRY, "pose_stamped": names.POSE_STAMPED}
# Accepted norms of an orientation's quaternion; an uninitialised message has the norm 0.
LEAST_NORM, LARGEST_NORM = 0.5, 2.0
# Largest coordinate, metres; beyond it, single precision no longer resolves a metre.
FARTHEST = 1e7


def pose_from_msg(message: Odometry | PoseStamped, world_frame: str) -> tuple[int, Pose]:
    """Return the stamp and the pose of a message in the world frame.

    The yaw is NaN if the orientation is not a unit quaternion, as in an uninitialised message. A
    height that is not finite, as of a driver that knows none, counts as 0. Only odometry has a
    twist; see `_twist`.

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
    height = float(pose.position.z)
    height = height if abs(height) <= FARTHEST else 0.0  # This holds for NaN too
    yaw, tilt = _attitude(pose.orientation)
    return stamp_ns, Pose(position, yaw, twist=twist, height=height, tilt=tilt)


def pose_from_cdr(data: bytes, kind: str, world_frame: str) -> tuple[int, Pose]:
    """Decode a recorded message of a kind of `POSE_TYPES` as `pose_from_msg` does."""
    return pose_from_msg(interfaces.decode(data, POSE_TYPES[kind]), world_frame)


def pose_to_cdr(
    pose: Pose, stamp_ns: int, world_frame: str, kind: str, child_frame: str = ""
) -> bytes:
    """Serialise a message of a kind of `POSE_TYPES`; an odometry's velocity is 0."""
    header, (x, y) = stamps.header(stamp_ns, world_frame), pose.position
    message: Any = PoseStamped(header=header)
    own = message.pose
    if kind == "odometry":
        message = Odometry(header=header, child_frame_id=child_frame)
        own = message.pose.pose
    own.position = Point(x=float(x), y=float(y), z=pose.height)
    own.orientation = Quaternion(**dict(zip("xyzw", of_angles(pose.yaw, pose.tilt), strict=True)))
    return interfaces.encode(message)


def _twist(message: Odometry) -> tuple[float, ...] | None:
    """Return an odometry's velocities, m/s, and rates of turn, rad/s, see `Pose.twist`, or None.

    It is unknown if a number along the ground is not finite or absurd, or if a variance is
    negative, as drivers mark unknown quantities; other such numbers count as 0. A twist of zeros
    with a covariance of zeros is one that was never set. If that of a platform at rest looks the
    same, the poses show the rest.
    """
    # Those of the motion along the ground: ahead, to the left, and the yaw rate.
    level_axes = 0, 1, 5
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    sent = (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
    # Places of the variances in a twist's covariance of 6 x 6.
    variances = [float(message.twist.covariance[index]) for index in (0, 7, 14, 21, 28, 35)]
    known = [
        # The largest rate of a platform, m/s and rad/s.
        abs(rate) <= 1e3 and variance >= 0.0  # False for NaN
        for rate, variance in zip(map(float, sent), variances, strict=True)
    ]
    if not all(known[axis] for axis in level_axes):
        return None
    is_set = any(float(sent[axis]) or variances[axis] for axis in level_axes)
    twist = [float(rate) if used else 0.0 for rate, used in zip(sent, known, strict=True)]
    return tuple(twist) if is_set else None


def _attitude(turn: Quaternion) -> tuple[float, tuple[float, float]]:
    """Return the yaw and the tilt of a pose; the yaw is NaN for an invalid quaternion."""
    # `hypot` avoids the squares of large finite numbers, which overflow with an error.
    norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if not LEAST_NORM <= norm <= LARGEST_NORM:  # It is true for NaN too
        return math.nan, LEVEL
    return attitude((turn.x, turn.y, turn.z, turn.w))


def plain(frame: str) -> str:
    """Return a frame's name without a leading slash, which means nothing."""
    return frame.removeprefix("/")


def transforms_from_cdr(data: bytes, needed: Callable[[str], bool]) -> list[Transform]:
    """Return the transforms of a serialised message; `needed` tells which child frames matter.

    Raise `RejectedMessageError`: ``schema`` if the bytes are no such message, or a stamp is
    invalid; ``frame`` if a frame has no name, a too long one, or itself as parent; ``not_finite``
    or ``range`` if a position is not finite or farther away than `FARTHEST`, or a rotation is no
    unit quaternion. A transform of a frame that is not needed is left out instead: other robots
    send theirs on the same topic.
    """
    try:
        sent = _unpacked(data)
    # An UnicodeDecodeError is a ValueError.
    except (struct.error, IndexError, KeyError, ValueError) as error:
        text = f"not a {names.TRANSFORMS}: {error}"
        raise RejectedMessageError("schema", text) from error
    found = []
    for parent, child, sec, nanosec, numbers in sent:
        try:
            found.append(_checked(parent, child, sec, nanosec, numbers))
        except RejectedMessageError:
            if needed(child):
                raise
    return found


def _unpacked(data: bytes) -> list[tuple[str, str, int, int, tuple[float, ...]]]:
    """Return parent, child, seconds and nanoseconds, translation and quaternion of each."""
    # Identifiers of plain CDR in an encapsulation's second byte, with the byte order.
    order = {0: ">", 1: "<"}[int.from_bytes(data[:2], "big")]
    body, at = memoryview(data)[4:], 4
    stamp, length, pose = (struct.Struct(order + code) for code in ("iI", "I", "7d"))

    def text() -> str:
        nonlocal at
        at += -at % 4
        (size,) = length.unpack_from(body, at)
        at += 4 + size
        if not size or at > len(body):
            raise ValueError(f"a string of {size} bytes in {len(body)}")
        return str(body[at - size : at - 1], "utf-8")

    found = []
    for _ in range(*length.unpack_from(body, 0)):
        at += -at % 4
        sec, nanosec = stamp.unpack_from(body, at)
        at += 8
        parent, child = plain(text()), plain(text())
        at += -at % 8
        found.append((parent, child, sec, nanosec, pose.unpack_from(body, at)))
        at += pose.size
    return found


def _checked(
    parent: str, child: str, sec: int, nanosec: int, numbers: tuple[float, ...]
) -> Transform:
    # Longest name of a frame.
    most_letters = 256
    what = f"transform of {quote(child)} in {quote(parent)}"
    if not (parent and child) or parent == child or max(len(parent), len(child)) > most_letters:
        text = f"{what}, must be two names of at most {most_letters} letters"
        raise RejectedMessageError("frame", text)
    if sec < 0 or nanosec >= stamps.NS_PER_S:
        raise RejectedMessageError("schema", f"{what}: stamp {sec} s {nanosec} ns is invalid")
    if not all(map(math.isfinite, numbers)):
        raise RejectedMessageError("not_finite", f"{what}: {numbers}, must be finite")
    if max(map(abs, numbers[:3])) > FARTHEST:
        text = f"{what}: position {numbers[:3]}, must be within {FARTHEST:g} m"
        raise RejectedMessageError("range", text)
    norm = math.hypot(*numbers[3:])
    if not LEAST_NORM <= norm <= LARGEST_NORM:
        text = f"{what}: quaternion {numbers[3:]}, must have the norm 1"
        raise RejectedMessageError("range", text)
    x, y, z, i, j, k, w = numbers
    rotation = i / norm, j / norm, k / norm, w / norm
    return Transform(parent, child, sec * stamps.NS_PER_S + nanosec, Placement((x, y, z), rotation))


# Types of the messages by their configured name.
MESSAGE_TYPES = {**POSE_TYPES, TF: names.TRANSFORMS}


def types_of(config: TrackerConfig) -> dict[str, str]:
    """Return the type of the messages on each topic with poses or transforms."""
    by_topic = config.radars_by_platform
    return {
        topic: MESSAGE_TYPES[config.inputs[own[0]].pose.message] for topic, own in by_topic.items()
    }


class MovingRadars:
    """Reads the messages on the topics of `TrackerConfig.radars_by_platform`."""

    def __init__(self, config: TrackerConfig) -> None:
        self._inputs, self._carried = config.inputs, config.radars_by_platform
        self._world_frame = config.world_frame
        # The radars that the transforms place, by frame.
        self._radars_of: dict[str, list[int]] = {}
        for index in self._carried.get(STATIC_TRANSFORMS, ()):
            self._radars_of.setdefault(plain(config.inputs[index].frame), []).append(index)
        self._buffer = TransformBuffer(
            plain(config.world_frame), self._radars_of, config.reset_threshold_s
        )

    def read(self, topic: str, data: bytes) -> tuple[list[RadarPose], list[PoseFault]]:
        """Return the poses that follow from a serialised message, and faults that harm none.

        Raise `RejectedMessageError`, see `pose_from_msg` and `transforms_from_cdr`.
        """
        carried = self._carried[topic]
        message = self._inputs[carried[0]].pose.message
        if message != TF:
            stamp_ns, pose = pose_from_cdr(data, message, self._world_frame)
            return [RadarPose(radar, stamp_ns, pose) for radar in carried], []
        static = topic == STATIC_TRANSFORMS
        sent = transforms_from_cdr(data, self._buffer.needs)
        faults = [fault for each in sent if (fault := self._buffer.add(each, static))]
        found = [
            RadarPose(radar, stamp_ns, pose)
            for frame, radars in self._radars_of.items()
            for stamp_ns, pose in self._buffer.poses(frame)
            for radar in radars
        ]
        return found, faults

    def missing(self, radar: int) -> str:
        """Return why a moving radar has no pose."""
        source = self._inputs[radar]
        text = f"no pose on {source.pose.topic} within {source.pose_max_age_s:g} s"
        if source.pose.message != TF:
            return text
        frame = plain(source.frame)
        late = self._buffer.late(frame)
        return self._buffer.broken(frame) or (f"{text}: {late}" if late else text)

    @property
    def broken(self) -> str:
        """Where the first chain of transforms is broken; empty if none is."""
        return next(filter(None, map(self._buffer.broken, self._radars_of)), "")

    def holds(self, topic: str) -> bool:
        """Return whether the last transforms on a topic hold until the next, however late."""
        fixed = topic == STATIC_TRANSFORMS or all(map(self._buffer.is_fixed, self._radars_of))
        return fixed and not self.broken
