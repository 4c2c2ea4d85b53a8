"""Estimates as markers, sized to be legible on a map.

The ellipses and the velocities of a class are one LINE_LIST marker each, and each target has a
label. The message is written as bytes, because the lists have thousands of points (see `cdr`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates

from . import cdr, stamps, vertical
from .ellipse import outline
from .palette import class_rgb

ELLIPSE_SIGMA = 3.0
# Sizes for a map that shows 30 km on a thousand pixels: lines are one to two pixels wide, letters
# are 13 pixels high, and the arrow of 60 m/s is 60 pixels long, longer than its ellipse.
VELOCITY_SECONDS = 30.0
LABEL_HEIGHT = 400.0
LINE_WIDTH = 40.0
# Extent of an arrow's head behind its tip and to each side, metres.
HEAD_LENGTH, HEAD_WIDTH = 4.0 * LINE_WIDTH, 2.0 * LINE_WIDTH
# Labels are dark, because viewers put a light box behind dark letters and a dark box behind light
# ones.
LABEL_COLOUR = (0.11, 0.13, 0.15)
ELLIPSE_POINTS = 33
# Bytes of an empty text with its length and padding, and of the empty members after it.
_TEXT, _AFTER_TEXT = 8, 21


def to_cdr(
    estimates: Estimates, frame: str, class_names: tuple[str, ...], datum: float = 0.0
) -> bytes:
    """Return a serialised ``visualization_msgs/MarkerArray``.

    It contains a DELETEALL marker, then the ellipses, the velocities and the labels of each class
    that has estimates, in the namespaces ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label``
    with the class's name. They are at the estimate's height, or in the map's plane if it is
    unknown. `datum` is the height of the map's zero, metres, to which flight levels in labels
    refer.
    """
    class_id, header = estimates.class_id, stamps.header(estimates.stamp_ns, frame)
    present = np.unique(class_id).tolist()
    writer = cdr.Writer()
    writer.put("I", 1 + 2 * len(present) + len(estimates))
    cdr.put_message(writer, Marker(header=header, action=Marker.DELETEALL))
    up = vertical.of(estimates).state
    position = np.column_stack([estimates.position, up[:, 0]])
    velocity = np.column_stack([estimates.velocity, up[:, 1]])
    ellipses = _ellipses(position, estimates.position_covariance)
    arrows = _arrows(position, velocity)
    texts = _labels(estimates, class_names, datum)
    places = (position + np.array([0.0, 2.0 * LABEL_HEIGHT, 0.0])).tolist()
    for index in present:
        name, mine = class_names[index], class_id == index
        line = Marker(header=header, type=Marker.LINE_LIST, color=_colour(class_rgb(index)))
        line.scale.x = LINE_WIDTH
        for kind, lines in (("ellipse", ellipses), ("velocity", arrows)):
            line.ns = f"{name}/{kind}"
            cdr.put_message(writer, line, points=lines[mine].reshape(-1, 3))
        label = Marker(header=header, ns=f"{name}/label", type=Marker.TEXT_VIEW_FACING)
        label.color, label.scale.z = _colour(LABEL_COLOUR), LABEL_HEIGHT
        rows = np.flatnonzero(mine).tolist()
        _put_labels(writer, label, [(row, places[row], texts[row]) for row in rows])
    return cdr.ENCAPSULATION + bytes(writer.data)


def _colour(rgb: tuple[float, float, float]) -> ColorRGBA:
    red, green, blue = rgb
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def label_text(track_id: int, class_name: str, share: float, more: str = "") -> str:
    """Return a target's label: track number, class, probability of the class, and `more`."""
    words = f"{track_id} {class_name} {share:.0%}" if track_id else f"{class_name} {share:.0%}"
    return f"{words} {more}" if more else words


def _labels(estimates: Estimates, class_names: tuple[str, ...], datum: float) -> list[str]:
    class_id, more = estimates.class_id.tolist(), vertical.words(estimates, datum)
    share = estimates.class_probability[np.arange(len(estimates)), class_id].tolist()
    return [
        label_text(track, class_names[k], s, words)
        for track, k, s, words in zip(
            estimates.track_id.tolist(), class_id, share, more, strict=True
        )
    ]


def _ellipses(position: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the end points of the ellipses' segments, shape (T, ELLIPSE_POINTS - 1, 2, 3)."""
    around = outline(covariance, ELLIPSE_SIGMA, ELLIPSE_POINTS).transpose(0, 2, 1)
    corners = np.repeat(position[:, None], ELLIPSE_POINTS, axis=1)
    corners[..., :2] += around
    return np.stack([corners[:, :-1], corners[:, 1:]], axis=2)


def _arrows(position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the end points of the arrows' shafts and head lines, shape (T, 6, 3)."""
    tip = position + VELOCITY_SECONDS * velocity
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    ahead = velocity[:, :2] / np.maximum(speed, np.finfo(float).tiny)[:, None]
    # A head is never longer than its shaft.
    back = np.minimum(HEAD_LENGTH, VELOCITY_SECONDS * speed)[:, None] * ahead
    aside = HEAD_WIDTH / HEAD_LENGTH * np.column_stack([-back[:, 1], back[:, 0]])
    sides = np.repeat(tip[:, None], 2, axis=1)
    sides[..., :2] += np.stack([aside - back, -aside - back], axis=1)
    return np.stack([position, tip, tip, sides[:, 0], tip, sides[:, 1]], axis=1)


def _put_labels(
    writer: cdr.Writer, label: Marker, labels: Iterable[tuple[int, Sequence[float], str]]
) -> None:
    """Append the labels of a class, each with its number, its position and its text.

    They differ in these three only, so that the other bytes are written once for each of the two
    alignments that a label can begin at.
    """
    templates = []
    for offset in (0, 4):
        begun = cdr.Writer(bytearray(offset))
        cdr.put_message(begun, label.header)
        begun.string(label.ns)
        begun.align(4)
        number = len(begun.data)
        # The number, the type and the action, four bytes each, precede the position.
        position = -(-(number + 12) // 8) * 8
        whole = cdr.Writer(bytearray(offset))
        cdr.put_message(whole, label)
        before_text = bytes(whole.data[offset : -_TEXT - _AFTER_TEXT])
        templates.append((before_text, number - offset, position - offset))
    after_text, data = bytes(whole.data[-_AFTER_TEXT:]), writer.data
    for row, place, text in labels:
        writer.align(4)
        begin = len(data)
        before_text, number, position = templates[begin % 8 // 4]
        data += before_text
        struct.pack_into("<i", data, begin + number, row)
        struct.pack_into("<3d", data, begin + position, *place)
        encoded = text.encode() + b"\0"
        # A text begins at a multiple of four bytes, and so do the members after it.
        data += struct.pack("<I", len(encoded)) + encoded + bytes(-len(encoded) % 4) + after_text
