"""Estimates as markers, sized to be legible on a map.

There are three markers per target, so the message is written as bytes (see `cdr`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from visualization_msgs.msg import Marker

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates

from . import cdr, stamps, vertical
from .ellipse import outline
from .palette import class_rgb

ELLIPSE_SIGMA = 3.0
# Chosen for a map that shows 30 km on a thousand pixels: lines are between one and two pixels wide,
# letters are 13 pixels high, and the arrow of 60 m/s is 60 pixels long, longer than its ellipse.
VELOCITY_SECONDS = 30.0
LABEL_HEIGHT = 400.0
LINE_WIDTH = 40.0
# Dark: viewers put a light box behind dark letters, and a black one behind those of light classes.
LABEL_COLOUR = (0.11, 0.13, 0.15)
ELLIPSE_POINTS = 33


def to_cdr(
    estimates: Estimates, frame: str, class_names: tuple[str, ...], datum: float = 0.0
) -> bytes:
    """Return a serialised ``visualization_msgs/MarkerArray``.

    It contains a DELETEALL marker, then an ellipse, a velocity and a label per estimate, in the
    namespaces ``NAME/ellipse``, ``NAME/velocity`` and ``NAME/label`` with the class's name. All are
    at the estimate's height, and in the map's plane where that is unknown. `datum`, the height of
    the map's zero, metres, is what labels have flight levels from.

    Estimates have the same layout if they have the same class, labels of equal length and the same
    alignment. Each layout is made once and filled in for all its estimates together.
    """
    clear = cdr.Writer()
    clear.put("I", 1 + 3 * len(estimates))
    _put(clear, estimates.stamp_ns, frame, "", Marker.ARROW, Marker.DELETEALL, points=0)
    labels = _labels(estimates, class_names, datum)
    rows: dict[cdr.Record, list[int]] = {}
    end = len(clear.data)
    for row, class_id in enumerate(estimates.class_id.tolist()):
        # Cached: equal layouts give the same record, also in later scans.
        start, name = end % cdr.LARGEST_ALIGNMENT, class_names[class_id]
        record = _record(start, frame, class_id, name, len(labels[row]))
        rows.setdefault(record, []).append(row)
        end += len(record.data)
    lines = _lines(estimates)
    pieces = [b""] * len(estimates)
    for record, chosen in rows.items():
        data, size = _filled(record, estimates, chosen, lines, labels), len(record.data)
        for place, row in enumerate(chosen):
            pieces[row] = data[place * size : (place + 1) * size]
    return cdr.ENCAPSULATION + bytes(clear.data) + b"".join(pieces)


def label_text(track_id: int, class_name: str, share: float, more: str = "") -> str:
    """Return a target's label: its track, its class, the class's probability and more of it."""
    words = f"{track_id} {class_name} {share:.0%}" if track_id else f"{class_name} {share:.0%}"
    return f"{words} {more}" if more else words


def _labels(estimates: Estimates, class_names: tuple[str, ...], datum: float) -> list[bytes]:
    class_id, more = estimates.class_id.tolist(), vertical.words(estimates, datum)
    share = estimates.class_probability[np.arange(len(estimates)), class_id].tolist()
    return [
        label_text(track, class_names[k], s, words).encode()
        for track, k, s, words in zip(
            estimates.track_id.tolist(), class_id, share, more, strict=True
        )
    ]


def _lines(estimates: Estimates) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions (T, 3), ends of arrows (T, 3) and ellipses (T, ELLIPSE_POINTS, 3)."""
    up = vertical.of(estimates).state
    position = np.column_stack([estimates.position, up[:, 0]])
    ahead = position + VELOCITY_SECONDS * np.column_stack([estimates.velocity, up[:, 1]])
    around = outline(estimates.position_covariance, ELLIPSE_SIGMA, ELLIPSE_POINTS)
    ellipse = np.repeat(position[:, None], ELLIPSE_POINTS, axis=1)
    ellipse[..., :2] += around.transpose(0, 2, 1)
    return position, ahead, ellipse


def _filled(
    record: cdr.Record,
    estimates: Estimates,
    chosen: list[int],
    lines: tuple[FloatArray, FloatArray, FloatArray],
    labels: Sequence[bytes],
) -> bytes:
    """Return the markers of the chosen estimates, which share one layout."""
    position, ahead, ellipse = (line[chosen] for line in lines)
    filled = record.repeated(len(chosen))
    for kind in ("ellipse", "velocity", "label"):
        filled[f"{kind}_stamp"] = divmod(estimates.stamp_ns, stamps.NS_PER_S)
        filled[f"{kind}_id"] = chosen
    filled["outline"] = ellipse
    filled["arrow"][:, 0], filled["arrow"][:, 1] = position, ahead
    filled["place"] = position + np.array([0.0, 2.0 * LABEL_HEIGHT, 0.0])
    filled["label"] = [labels[row] for row in chosen]
    return filled.tobytes()


@lru_cache(maxsize=256)
def _record(start: int, frame: str, class_id: int, name: str, label_size: int) -> cdr.Record:
    """Lay out the three markers of an estimate, from byte `start` of the message."""
    writer = cdr.Writer(start)
    colour = class_rgb(class_id)
    kinds = (
        ("ellipse", Marker.LINE_STRIP, (LINE_WIDTH, 0.0, 0.0), ELLIPSE_POINTS, ""),
        ("velocity", Marker.ARROW, (LINE_WIDTH, 3.0 * LINE_WIDTH, 3.0 * LINE_WIDTH), 2, ""),
        ("label", Marker.TEXT_VIEW_FACING, (0.0, 0.0, LABEL_HEIGHT), 0, " " * label_size),
    )
    at = {
        kind: _put(
            *(writer, 0, frame, f"{name}/{kind}", shape),
            scale=scale,
            colour=LABEL_COLOUR if kind == "label" else colour,
            points=points,
            text=text,
        )
        for kind, shape, scale, points, text in kinds
    }
    members = {f"{kind}_stamp": ("(2,)<i4", at[kind]["stamp"]) for kind in at}
    members |= {f"{kind}_id": ("<i4", at[kind]["id"]) for kind in at}
    members |= {
        "outline": (f"({ELLIPSE_POINTS},3)<f8", at["ellipse"]["points"]),
        "arrow": ("(2,3)<f8", at["velocity"]["points"]),
        "place": ("(3,)<f8", at["label"]["position"]),
        "label": (f"S{label_size}", at["label"]["text"]),
    }
    return cdr.Record(bytes(writer.data), cdr.layout(members, len(writer.data)))


def _put(
    writer: cdr.Writer,
    stamp_ns: int,
    frame: str,
    namespace: str,
    kind: int,
    action: int = Marker.ADD,
    *,
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
    colour: tuple[float, ...] | None = None,
    points: int,
    text: str = "",
) -> dict[str, int]:
    """Append a ``visualization_msgs/Marker`` member by member; return the offsets of some."""
    at = {"stamp": writer.header(stamp_ns, frame)}
    writer.string(namespace)
    at["id"] = writer.put("i", 0)
    writer.put("i", kind, action)
    at["position"] = writer.put("d", 0.0, 0.0, 0.0)
    writer.put("d", 0.0, 0.0, 0.0, 1.0)  # orientation
    writer.put("d", *scale)
    writer.put("f", *((*colour, 1.0) if colour else (0.0, 0.0, 0.0, 0.0)))
    writer.put("i", 0)  # lifetime, seconds and nanoseconds
    writer.put("I", 0)
    writer.put("B", 0)  # frame_locked
    writer.put("I", points)
    if points:
        at["points"] = writer.put("d", *[0.0] * (3 * points))
    writer.put("I", 0)  # colors
    writer.string("")  # texture_resource
    writer.header(0, "")  # texture
    writer.string("")
    writer.put("I", 0)
    writer.put("I", 0)  # uv_coordinates
    at["text"] = writer.string(text)
    writer.string("")  # mesh_resource
    writer.string("")  # mesh_file
    writer.put("I", 0)
    writer.put("B", 0)  # mesh_use_embedded_materials
    return at
