"""Markers and poses as serialised messages: what publishers of many estimates send.

The same as `markers.to_msg` and `estimates.to_pose_array` make, which say in words what is in them,
but many times faster to make and to publish.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from visualization_msgs.msg import Marker

from phd_jdtc_ros.core.motion import POSITION, VX, VY
from phd_jdtc_ros.core.types import Estimates, FloatArray

from . import cdr, stamps
from .markers import (
    ELLIPSE_POINTS,
    ELLIPSE_SIGMA,
    LABEL_HEIGHT,
    LINE_WIDTH,
    VELOCITY_SECONDS,
    label_text,
)
from .palette import class_rgb


def pose_array(estimates: Estimates, class_id: int, frame: str) -> bytes:
    """Return what `estimates.to_pose_array` does, serialised."""
    rows = estimates.state[estimates.class_id == class_id]
    half = 0.5 * np.arctan2(rows[:, VY], rows[:, VX])
    # x y z of the position, x y z w of the orientation.
    pose = np.zeros((len(rows), 7))
    pose[:, 0], pose[:, 1] = rows[:, POSITION[0]], rows[:, POSITION[1]]
    pose[:, 5], pose[:, 6] = np.sin(half), np.cos(half)
    writer = cdr.Writer()
    writer.header(estimates.stamp_ns, frame)
    writer.put("I", len(rows))
    if len(rows):
        writer.put("d")
    return cdr.ENCAPSULATION + bytes(writer.data) + pose.astype("<f8").tobytes()


def marker_array(estimates: Estimates, frame: str, class_names: tuple[str, ...]) -> bytes:
    """Return what `markers.to_msg` does, serialised.

    Estimates of one class whose labels are equally long, and that begin at the same alignment,
    have the same layout; each layout is made once and filled in for all of them together.
    """
    head = cdr.Writer()
    head.put("I", 1 + 3 * len(estimates))
    _put(head, estimates.stamp_ns, frame, "", Marker.ARROW, Marker.DELETEALL, points=0)
    class_id = estimates.class_id.tolist()
    share = estimates.class_probability[np.arange(len(estimates)), class_id].tolist()
    labels = [
        label_text(track, class_names[k], s).encode()
        for track, k, s in zip(estimates.track_id.tolist(), class_id, share, strict=True)
    ]
    rows: dict[cdr.Record, list[int]] = {}
    end = len(head.data)
    for index, of_class in enumerate(class_id):
        # Equal for equal layouts, and kept from scan to scan.
        record = _record(
            end % cdr.LARGEST_ALIGNMENT, frame, of_class, class_names[of_class], len(labels[index])
        )
        rows.setdefault(record, []).append(index)
        end += len(record.data)

    outline = _outlines(estimates)
    position = estimates.state[:, list(POSITION)]
    ahead = position + VELOCITY_SECONDS * estimates.state[:, [VX, VY]]
    pieces = [b""] * len(estimates)
    for record, chosen in rows.items():
        filled = record.repeated(len(chosen))
        for kind in ("ellipse", "velocity", "label"):
            filled[f"{kind}_stamp"] = divmod(estimates.stamp_ns, stamps.NS_PER_S)
            filled[f"{kind}_id"] = chosen
        filled["outline"][..., :2] = outline[chosen]
        filled["arrow"][:, 0, :2], filled["arrow"][:, 1, :2] = position[chosen], ahead[chosen]
        filled["place"] = position[chosen] + [0.0, 2.0 * LABEL_HEIGHT]
        filled["label"] = [labels[row] for row in chosen]
        data, size = filled.tobytes(), len(record.data)
        for place, row in enumerate(chosen):
            pieces[row] = data[place * size : (place + 1) * size]
    return cdr.ENCAPSULATION + bytes(head.data) + b"".join(pieces)


@lru_cache(maxsize=256)
def _record(start: int, frame: str, class_id: int, name: str, label_size: int) -> cdr.Record:
    """Lay out the three markers of an estimate, from the byte `start` of the message on."""
    writer = cdr.Writer(start)
    base = (writer, 0, frame)
    colour = class_rgb(class_id)
    ellipse = _put(
        *base,
        f"{name}/ellipse",
        Marker.LINE_STRIP,
        scale=(LINE_WIDTH, 0.0, 0.0),
        colour=colour,
        points=ELLIPSE_POINTS,
    )
    velocity = _put(
        *base,
        f"{name}/velocity",
        Marker.ARROW,
        scale=(LINE_WIDTH, 3.0 * LINE_WIDTH, 3.0 * LINE_WIDTH),
        colour=colour,
        points=2,
    )
    text = _put(
        *base,
        f"{name}/label",
        Marker.TEXT_VIEW_FACING,
        scale=(0.0, 0.0, LABEL_HEIGHT),
        colour=colour,
        points=0,
        text=" " * label_size,
    )
    members = [
        *(
            member
            for name, marker in (("ellipse", ellipse), ("velocity", velocity), ("label", text))
            for member in (
                (f"{name}_stamp", "(2,)<i4", marker["stamp"]),
                (f"{name}_id", "<i4", marker["id"]),
            )
        ),
        ("outline", f"({ELLIPSE_POINTS},3)<f8", ellipse["points"]),
        ("arrow", "(2,3)<f8", velocity["points"]),
        ("place", "(2,)<f8", text["position"]),
        ("label", f"S{label_size}", text["text"]),
    ]
    return cdr.Record(
        bytes(writer.data),
        np.dtype(
            {
                "names": [name for name, _, _ in members],
                "formats": [kind for _, kind, _ in members],
                "offsets": [offset for _, _, offset in members],
                "itemsize": len(writer.data),
            }
        ),
    )


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
    """Append a ``visualization_msgs/Marker`` member by member; return where some of them stand."""
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


def _outlines(estimates: Estimates) -> FloatArray:
    """Return outlines as `markers.to_msg` draws them, shape (T, ELLIPSE_POINTS, 2)."""
    position = list(POSITION)
    variance, axes = np.linalg.eigh(estimates.covariance[:, position][:, :, position])
    turn = np.linspace(0.0, 2.0 * np.pi, ELLIPSE_POINTS)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    spread = axes * (ELLIPSE_SIGMA * np.sqrt(np.maximum(variance, 0.0)))[:, None, :]
    outline: FloatArray = (spread @ circle).transpose(0, 2, 1)
    outline[:, -1] = outline[:, 0]
    return estimates.state[:, None, position] + outline
