"""Where the platforms of moving radars are: odometry, poses or transforms, as poses by radar.

Transforms are ``tf2_msgs/TFMessage``, as on ``/tf`` and ``/tf_static``. tf2_msgs is not part of
every installation, so the message is read from its bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.place_forms import STATIC_TRANSFORMS, TF
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.transforms import Placement, Transform, TransformBuffer

from ..encoding import names, stamps
from ..encoding.errors import RejectedMessageError, quote
from . import platform_poses
from .platform_poses import FARTHEST, LARGEST_NORM, LEAST_NORM

# Longest name of a frame.
MOST_LETTERS = 256
# Identifiers of plain CDR in an encapsulation's second byte, with the byte order.
_ORDERS = {0: ">", 1: "<"}


def plain(frame: str) -> str:
    """Return a frame's name without a leading slash, which means nothing."""
    return frame.removeprefix("/")


def from_cdr(data: bytes, needed: Callable[[str], bool]) -> list[Transform]:
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
    order = _ORDERS[int.from_bytes(data[:2], "big")]
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
    what = f"transform of {quote(child)} in {quote(parent)}"
    if not (parent and child) or parent == child or max(len(parent), len(child)) > MOST_LETTERS:
        text = f"{what}, must be two names of at most {MOST_LETTERS} letters"
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
TYPES = {**platform_poses.TYPES, TF: names.TRANSFORMS}


def types_of(config: TrackerConfig) -> dict[str, str]:
    """Return the type of the messages on each topic with poses or transforms."""
    by_topic = config.radars_by_platform
    return {topic: TYPES[config.inputs[own[0]].pose.message] for topic, own in by_topic.items()}


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

        Raise `RejectedMessageError`, see `platform_poses.from_msg` and `from_cdr`.
        """
        carried = self._carried[topic]
        message = self._inputs[carried[0]].pose.message
        if message != TF:
            stamp_ns, pose = platform_poses.from_cdr(data, message, self._world_frame)
            return [RadarPose(radar, stamp_ns, pose) for radar in carried], []
        static = topic == STATIC_TRANSFORMS
        sent = from_cdr(data, self._buffer.needs)
        faults = [PoseFault.PARENT for each in sent if self._buffer.add(each, static)]
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
