"""Transforms between frames: ``tf2_msgs/TFMessage``, as on ``/tf`` and ``/tf_static``.

tf2_msgs is not part of every installation, so the message is read from its bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from phd_jdtc_ros.core.intake.transforms import Placement, Transform

from ..encoding import names, stamps
from ..encoding.errors import RejectedMessageError, quote
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
