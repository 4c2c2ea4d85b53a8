"""Estimates as markers, sized to be legible on a map.

The ellipses and the velocities of a class are one LINE_LIST marker each, and each target has a
label. The message is written as bytes, because the lists have thousands of points (see `cdr`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from visualization_msgs.msg import Marker

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates

from . import cdr, vertical
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
_NO_POINTS = np.zeros((0, 3))


def _no_texture() -> bytes:
    """Return the empty members between points and text."""
    writer = cdr.Writer()
    writer.put("I", 0)  # colors
    writer.string("")  # texture_resource
    writer.header(0, "")  # texture
    writer.string("")
    writer.put("I", 0, 0)  # its data, and uv_coordinates
    return bytes(writer.data)


def _no_mesh() -> bytes:
    """Return the empty members after the text."""
    writer = cdr.Writer()
    writer.string("")  # mesh_resource
    writer.string("")  # mesh_file
    writer.put("I", 0)
    writer.put("B", 0)  # mesh_use_embedded_materials
    return bytes(writer.data)


_NO_TEXTURE, _NO_MESH = _no_texture(), _no_mesh()


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
    class_id = estimates.class_id
    present = np.unique(class_id).tolist()
    writer, at = cdr.Writer(), (estimates.stamp_ns, frame)
    writer.put("I", 1 + 2 * len(present) + len(estimates))
    _put(writer, at, "", Marker.ARROW, action=Marker.DELETEALL)
    up = vertical.of(estimates).state
    position = np.column_stack([estimates.position, up[:, 0]])
    velocity = np.column_stack([estimates.velocity, up[:, 1]])
    ellipses = _ellipses(position, estimates.position_covariance)
    arrows = _arrows(position, velocity)
    labels = _labels(estimates, class_names, datum)
    places = (position + np.array([0.0, 2.0 * LABEL_HEIGHT, 0.0])).tolist()
    for index in present:
        name, colour, mine = class_names[index], class_rgb(index), class_id == index
        for kind, lines in (("ellipse", ellipses), ("velocity", arrows)):
            _put(
                *(writer, at, f"{name}/{kind}", Marker.LINE_LIST),
                scale=(LINE_WIDTH, 0.0, 0.0),
                colour=colour,
                points=lines[mine].reshape(-1, 3),
            )
        rows = np.flatnonzero(mine).tolist()
        _put_labels(writer, at, f"{name}/label", [(row, places[row], labels[row]) for row in rows])
    return cdr.ENCAPSULATION + bytes(writer.data)


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
    writer: cdr.Writer,
    at: tuple[int, str],
    namespace: str,
    labels: Iterable[tuple[int, Sequence[float], str]],
) -> None:
    """Append the labels of a class, each with its number, its position and its text.

    They differ in these three only, so that the bytes before the text are written once for each
    of the two alignments that a label can begin at.
    """
    beginnings = []
    for offset in (0, 4):
        begun = cdr.Writer(bytearray(offset))
        begun.header(*at)
        begun.string(namespace)
        begun.align(4)
        number = len(begun.data)
        begun.put("i", 0, Marker.TEXT_VIEW_FACING, Marker.ADD)
        begun.align(8)
        position = len(begun.data)
        _put_shape(begun, (0.0, 0.0, 0.0), (0.0, 0.0, LABEL_HEIGHT), LABEL_COLOUR, _NO_POINTS)
        beginnings.append((bytes(begun.data[offset:]), number - offset, position - offset))
    data = writer.data
    for number_, place, text in labels:
        writer.align(4)
        begin = len(data)
        beginning, number, position = beginnings[begin % 8 // 4]
        data += beginning
        struct.pack_into("<i", data, begin + number, number_)
        struct.pack_into("<3d", data, begin + position, *place)
        _put_text(writer, text)


def _put(
    writer: cdr.Writer,
    at: tuple[int, str],
    namespace: str,
    kind: int,
    action: int = Marker.ADD,
    *,
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
    colour: tuple[float, ...] | None = None,
    points: FloatArray = _NO_POINTS,
) -> None:
    """Append a ``visualization_msgs/Marker`` without text; `at` is its stamp and frame."""
    writer.header(*at)
    writer.string(namespace)
    writer.put("i", 0, kind, action)
    _put_shape(writer, (0.0, 0.0, 0.0), scale, colour, points)
    _put_text(writer, "")


def _put_shape(
    writer: cdr.Writer,
    position: Sequence[float],
    scale: tuple[float, float, float],
    colour: tuple[float, ...] | None,
    points: FloatArray,
) -> None:
    """Append a marker's members from its pose to what is before its text."""
    writer.put("d", *position, *(0.0, 0.0, 0.0, 1.0), *scale)  # the orientation is the identity
    writer.put("f", *((*colour, 1.0) if colour else (0.0, 0.0, 0.0, 0.0)))
    writer.put("I", 0, 0, 0, len(points))  # lifetime, padded frame_locked, number of points
    writer.doubles(points)
    writer.data += _NO_TEXTURE


def _put_text(writer: cdr.Writer, text: str) -> None:
    """Append a marker's text and the members after it."""
    writer.string(text)
    writer.align(4)
    writer.data += _NO_MESH
