"""Clouds of self-reports to `SelfReports`."""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.columns.report_selection import PLACES, Told, select
from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.core.types.reports import NAME_SIZE

from ..encoding import RejectedMessageError, interfaces, names, point_cloud, stamps

# The fields that a cloud may have, with the types of each.
NUMBERS = ("f4", "f8", "u1", "i1", "u2", "i2", "u4", "i4")
OPTIONAL = {
    **dict.fromkeys(("vx", "vy", "speed", "course", "heading", "height"), point_cloud.FLOATS),
    **dict.fromkeys(("interval", "ahead", "left", "length"), point_cloud.FLOATS),
    **dict.fromkeys(("std", "x_std", "y_std", "correlation"), point_cloud.FLOATS),
    **dict.fromkeys(("address", "space", "type", "accurate"), NUMBERS),
    "time": ("f8",),
    "name": (f"{NAME_SIZE}u1",),
}


def from_msg(cloud: PointCloud2, own: ReportsParameters) -> Told:
    """Decode the reports of a cloud; docs/reports.md lists its fields.

    Raise `RejectedMessageError`: ``schema`` without places, or if these are latitudes and
    longitudes and the tracker has no ``world_origin``; otherwise see `stamps.of_input` and
    `point_cloud.decode`.
    """
    stamp_ns, present = stamps.of_input(cloud.header), set(point_cloud.field_names(cloud))
    if not (present or cloud.width * cloud.height or len(cloud.data)):
        return select(stamp_ns, own, {"x": np.zeros(0), "y": np.zeros(0)})
    place = next((both for both in PLACES if present.issuperset(both)), PLACES[0])
    if place == PLACES[0] and present.issuperset(place) and own.plane is None:
        raise RejectedMessageError(
            "schema", "latitude and longitude given, which need the parameter world_origin"
        )
    wanted: dict[str, tuple[str, ...]] = dict.fromkeys(place, point_cloud.FLOATS)
    wanted |= {name: types for name, types in OPTIONAL.items() if name in present}
    # Converting a signalling NaN warns. Such a value is handled like any other NaN.
    with np.errstate(invalid="ignore"):
        return select(stamp_ns, own, point_cloud.decode(cloud, wanted))


def from_cdr(data: bytes, own: ReportsParameters) -> Told:
    """Decode the reports of a recorded cloud; see `from_msg`."""
    message: Any = interfaces.decode(data, names.CLOUD)
    return from_msg(message, own)
