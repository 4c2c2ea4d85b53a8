"""The radars' frames as static transforms, ``tf2_msgs/TFMessage``.

tf2_msgs is not part of every ROS installation, so the message is written as bytes (see `cdr`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..encoding import cdr


class Mounting(NamedTuple):
    """The pose of a frame in the world frame."""

    frame: str
    position: tuple[float, float]  # Metres
    yaw: float  # Radians, counter-clockwise


def to_cdr(mountings: Sequence[Mounting], stamp_ns: int, world_frame: str) -> bytes:
    """Return a serialised ``tf2_msgs/TFMessage`` with a transform per frame.

    The world frame is left out, because a frame cannot be its own parent.
    """
    placed = [mounting for mounting in mountings if mounting.frame != world_frame]
    writer = cdr.Writer()
    writer.put("I", len(placed))
    for frame, (x, y), yaw in placed:
        writer.header(stamp_ns, world_frame)
        writer.string(frame)
        writer.put("d", x, y, 0.0)
        writer.put("d", 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
    return writer.message()
