"""Conflicts to and from point clouds, and to markers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from phd_jdtc_ros.core.conflicts.model import Conflicts, words
from phd_jdtc_ros.core.models.zones import EXCLUSION, GUARD, LAND, Zone

from ..encoding import point_cloud, stamps

# The columns of conflicts that are published under their own names, in order.
WHOLE = ("kind", "first", "second", "alarm")
REAL = ("probability", "time_s", "cpa", "tcpa_s", "ahead", "starboard")
# Red, green and blue of zones by kind, and of alarms before and after they are acknowledged.
ZONES = {GUARD: (0.9, 0.6, 0.0), EXCLUSION: (0.6, 0.6, 0.6), LAND: (0.5, 0.4, 0.2)}
ALARMS = {1: (0.85, 0.1, 0.1), 2: (0.8, 0.5, 0.5)}
# Sizes of lines, marks and letters for a map that shows 30 km on a thousand pixels, metres.
LINE, MARK, LETTERS = 40.0, 300.0, 400.0


def to_cdr(found: Conflicts, frame: str) -> bytes:
    """Return conflicts as a serialised ``sensor_msgs/PointCloud2``, empty or not.

    The fields are ``x y z`` (FLOAT32, metres, z is 0), `WHOLE` (UINT32) and `REAL` (FLOAT32, SI
    units, NaN where undefined); see `Conflicts`.
    """
    x, y = found.place.T
    columns = {"x": x, "y": y, "z": np.zeros(len(found))}
    columns |= {name: getattr(found, name) for name in (*WHOLE, *REAL)}
    return point_cloud.to_cdr(found.stamp_ns, frame, columns)


def from_msg(cloud: PointCloud2) -> Conflicts:
    """Decode the conflicts of a cloud.

    Raise `RejectedMessageError`; see `point_cloud.decode` and `stamps.of_header`.
    """
    wanted = dict.fromkeys(("x", "y", *REAL), point_cloud.FLOATS)
    columns = point_cloud.decode(cloud, wanted | dict.fromkeys(WHOLE, point_cloud.UNSIGNED))
    given = ("x", "y", "probability", "time_s")
    point_cloud.require_finite({name: columns[name] for name in given})
    place = np.stack([columns.pop("x"), columns.pop("y")], axis=1)
    return Conflicts(stamps.of_header(cloud.header), place=place, **columns)


def to_markers(found: Conflicts, zones: Sequence[Zone], frame: str) -> MarkerArray:
    """Return the zones, and the alarms in words at the places of the conflicts.

    The first marker deletes all earlier ones.
    """
    header = stamps.header(found.stamp_ns, frame)
    markers = [Marker(header=header, action=Marker.DELETEALL)]

    def add(kind: int, namespace: str, colour: tuple[float, float, float], size: float) -> Marker:
        marker = Marker(header=header, type=kind, ns=namespace, id=len(markers))
        marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=1.0)
        marker.scale.x = marker.scale.y = marker.scale.z = size
        marker.pose.orientation.w = 1.0
        markers.append(marker)
        return marker

    for zone in zones:
        outline = add(Marker.LINE_LIST, f"{zone.kind}/{zone.name}", ZONES[zone.kind], LINE)
        outline.points = [Point(x=x, y=y) for x, y in zone.sides.reshape(-1, 2).tolist()]
    for row in np.flatnonzero(found.alarm).tolist():
        colour, (x, y) = ALARMS[int(found.alarm[row])], found.place[row].tolist()
        mark = add(Marker.SPHERE, "alarm", colour, MARK)
        mark.pose.position = Point(x=x, y=y)
        text = add(Marker.TEXT_VIEW_FACING, "alarm/text", colour, LETTERS)
        text.pose.position, text.text = Point(x=x, y=y + 2.0 * MARK), words(found, row, zones)
    return MarkerArray(markers=markers)
