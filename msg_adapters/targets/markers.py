"""The colours of the classes in markers, pages and pictures.

They are Okabe and Ito's palette without black, which is safe for colour-blind readers.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache

import numpy as np
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates

from ..encoding import cdr, stamps
from . import vertical

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def class_colour(class_id: int) -> str:
    """Return the colour of a class as ``#rrggbb``; colours repeat after the sixth."""
    return COLOURS[class_id % len(COLOURS)]


def class_rgb(class_id: int) -> tuple[float, float, float]:
    """Return the colour of a class as red, green and blue from 0 to 1."""
    digits = class_colour(class_id)
    red, green, blue = (int(digits[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue


LINES, LABEL, ADD = Marker.LINE_LIST, Marker.TEXT_VIEW_FACING, Marker.ADD
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
# Sides of an ellipse's outline, which is within 1 % of the ellipse.
ELLIPSE_SIDES = 24
# The ends of the sides as a circle's cosines and sines, and the weight 1 of its centre.
_ANGLE = 2.0 * np.pi / ELLIPSE_SIDES * (np.arange(1, 2 * ELLIPSE_SIDES + 1) // 2 % ELLIPSE_SIDES)
_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE), np.ones_like(_ANGLE)], axis=1)
# The ends of an arrow's lines as sums of its position, its shaft, its head's length along the shaft
# and the same across.
_TIP, _ASIDE = (1, 1, 0, 0), HEAD_WIDTH / HEAD_LENGTH
_ARROW = np.array([(1, 0, 0, 0), _TIP, _TIP, (1, 1, -1, _ASIDE), _TIP, (1, 1, -1, -_ASIDE)])
# Bytes of the number of markers or points, of a stamp, and of an empty text; and of the empty
# members after points and after a text.
_COUNT, _STAMP, _TEXT, _AFTER_POINTS, _AFTER_TEXT = 4, 8, 8, 73, 21
# A marker's number, type, action and position, whose doubles are aligned, at an even and at an odd
# multiple of four bytes.
_NUMBER_TO_POSITION = struct.Struct("<3i4x3d"), struct.Struct("<3i3d")


def to_cdr(
    estimates: Estimates, frame: str, class_names: tuple[str, ...], datum: float = 0.0
) -> bytes:
    """Return a serialised ``visualization_msgs/MarkerArray``.

    It contains a DELETEALL marker, then the ellipses, the velocities and the labels of each class
    that has estimates, in the namespaces ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label``
    with the class's name. They are at the estimate's height, or in the map's plane if it is
    unknown; in space an ellipse is three of an ellipsoid. `datum` is the height of the map's zero,
    metres, to which flight levels in labels refer.
    """
    order = np.argsort(estimates.class_id, kind="stable")
    estimates = estimates.take(order)
    counts = np.bincount(estimates.class_id).tolist()
    up = vertical.states(estimates)
    position = np.column_stack([estimates.position, up[:, 0]])
    if estimates.space.vertical:
        covariance = vertical.known_or_zero(estimates.covariance_in_space[:, :3, :3])
        flat = np.isnan(estimates.known_attributes.height[:, 0])
        covariance[flat, :2, :2] = estimates.position_covariance[flat]
        ellipses = _ellipsoids(position, covariance)
    else:
        ellipses = _ellipses(position, estimates.position_covariance)
    arrows = _arrows(position, np.column_stack([estimates.velocity, up[:, 1]]))
    places = position + np.array([0.0, 2.0 * LABEL_HEIGHT, 0.0])
    texts = _labels(estimates, class_names, datum)
    stamp, end = struct.pack("<iI", *divmod(estimates.stamp_ns, stamps.NS_PER_S)), 0
    writer = cdr.Writer()
    writer.put("I", 1 + 2 * sum(map(bool, counts)) + len(estimates))
    writer.add(stamp + _clearing(frame))
    for index, count in enumerate(counts):
        if not count:
            continue
        begin, end = end, end + count
        name, mine = class_names[index], slice(begin, end)
        for kind, ends in (("ellipse", ellipses), ("velocity", arrows)):
            names, after = _parts(frame, f"{name}/{kind}", LINES, class_rgb(index))
            _begin(writer, stamp + names, LINES, 0, (0.0, 0.0, 0.0))
            writer.add(after[: -_COUNT - _AFTER_POINTS])
            writer.rows(ends[mine].reshape(-1, 3))
            writer.add(after[-_AFTER_POINTS:])
        names, after = _parts(frame, f"{name}/label", LABEL, LABEL_COLOUR)
        before, after = after[: -_TEXT - _AFTER_TEXT], after[-_AFTER_TEXT:]
        for number, place, text in zip(
            order[mine].tolist(), places[mine].tolist(), texts[mine], strict=True
        ):
            _begin(writer, stamp + names, LABEL, number, place)
            writer.add(before)
            writer.string(text)
            writer.align(4)
            writer.add(after)
    return writer.message()


def _labels(estimates: Estimates, class_names: tuple[str, ...], datum: float) -> list[str]:
    """Return each target's track number, class, probability of the class, and further words."""
    class_id, more = estimates.class_id.tolist(), vertical.words(estimates, datum)
    share = estimates.class_probability[np.arange(len(estimates)), class_id]
    percent = np.rint(100.0 * share).astype(np.int64).tolist()
    return [
        f"{f'{track} ' if track else ''}{class_names[k]} {p}%{words and f' {words}'}"
        for track, k, p, words in zip(
            estimates.track_id.tolist(), class_id, percent, more, strict=True
        )
    ]


def _ellipses(position: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the ends of the ellipses' sides, shape (T, 2 * ELLIPSE_SIDES, 3)."""
    # The square root of a matrix of two rows has a closed form; eigenvectors would take as long as
    # the rest of the message. A negative determinant or variance from rounding counts as zero.
    variance, across = covariance[:, (0, 1), (0, 1)], covariance[:, 0, 1]
    both = np.sqrt(np.maximum(variance[:, 0] * variance[:, 1] - across**2, 0.0))
    total = np.maximum(np.abs(variance.sum(axis=1) + 2.0 * both), np.finfo(float).tiny)
    root = covariance + both[:, None, None] * np.eye(2)
    frame = np.zeros((len(position), 3, 3))
    frame[:, :2, :2] = ELLIPSE_SIGMA / np.sqrt(total)[:, None, None] * root
    frame[:, 2] = position
    ends: FloatArray = _CIRCLE @ frame
    return ends


def _ellipsoids(position: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the ends of the sides of each ellipsoid's three ellipses, (T, 6 * ELLIPSE_SIDES, 3).

    The covariances, (T, 3, 3), are zero along z where a height is unknown: an ellipsoid is then
    flat.
    """
    variance, axes = np.linalg.eigh(covariance)
    root = (
        ELLIPSE_SIGMA * (axes * np.sqrt(np.maximum(variance, 0.0))[:, None]) @ axes.swapaxes(1, 2)
    )
    # Images of the circles about z, y and x.
    pairs = ((0, 1), (0, 2), (1, 2))
    ends = [
        _CIRCLE @ np.stack([root[:, one], root[:, other], position], axis=1) for one, other in pairs
    ]
    return np.concatenate(ends, axis=1)


def _arrows(position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the ends of the arrows' shafts and head lines, shape (T, 6, 3)."""
    shaft = VELOCITY_SECONDS * velocity
    length = np.hypot(shaft[:, 0], shaft[:, 1])
    # A head is never longer than its shaft.
    share = np.minimum(HEAD_LENGTH, length) / np.maximum(length, np.finfo(float).tiny)
    frame = np.zeros((len(position), 4, 3))
    frame[:, 0], frame[:, 1] = position, shaft
    frame[:, 2, :2] = share[:, None] * shaft[:, :2]
    frame[:, 3, 0], frame[:, 3, 1] = -frame[:, 2, 1], frame[:, 2, 0]
    ends: FloatArray = _ARROW @ frame
    return ends


@cache
def _clearing(frame: str) -> bytes:
    """Return the marker that comes first and clears the display, without its stamp."""
    writer = cdr.Writer()
    writer.put("I", 0)
    cdr.put_message(writer, Marker(header=Header(frame_id=frame), action=Marker.DELETEALL))
    return writer.data[_COUNT + _STAMP :]


@cache
def _parts(frame: str, ns: str, kind: int, rgb: tuple[float, float, float]) -> tuple[bytes, bytes]:
    """Return a marker's bytes between its stamp and its number, and those after its position."""
    marker = Marker(header=Header(frame_id=frame), ns=ns, type=kind)
    marker.color = ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)
    if kind == LINES:
        marker.scale.x = LINE_WIDTH
    else:
        marker.scale.z = LABEL_HEIGHT
    begun, whole = cdr.Writer(), cdr.Writer()
    cdr.put_message(whole, marker)
    cdr.put_message(begun, marker.header)
    begun.string(ns)
    begun.align(4)
    names = begun.data[_STAMP:]
    _begin(begun, b"", kind, 0, (0.0, 0.0, 0.0))
    return names, whole.data[begun.size :]


def _begin(
    writer: cdr.Writer, names: bytes, kind: int, number: int, place: Sequence[float]
) -> None:
    """Append a marker until its position; `names` are the bytes until its number."""
    writer.align(4)
    writer.add(names)
    odd = writer.size // 4 % 2
    writer.add(_NUMBER_TO_POSITION[odd].pack(number, kind, ADD, *place))
