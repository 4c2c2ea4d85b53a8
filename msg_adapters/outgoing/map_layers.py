"""The detections of all radars in the world frame, as one point cloud for viewers.

Drivers differ in field names, units and frames; this cloud is uniform for all radars.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid

from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster

from ..encoding import RejectedMessageError, cdr, point_cloud, stamps


def detections_to_cdr(scan: Scan, radars: Sequence[Sensor], frame: str) -> bytes:
    """Return a scan's detections, empty or not, as a serialised ``sensor_msgs/PointCloud2``.

    The fields are ``x y z amplitude`` (FLOAT32; metres, linear envelope) and ``radar_index``
    (UINT32, from 0 in the configured order). z is the height; if it is unknown, 0, or in space the
    antenna's. The amplitude is 0 if the radar reports none, because viewers draw NaN in an
    undefined colour.
    """
    # Rows x, y, z, amplitude and radar index.
    points, end = np.zeros((5, sum(len(found or ()) for found in scan.detections))), 0
    for index, (radar, found) in enumerate(zip(radars, scan.detections, strict=True)):
        if found is not None:
            begin, end = end, end + len(found)
            own = points[:, begin:end]
            place = radar.at(found.pose).to_world(found.measurement).T
            own[: len(place)] = place
            if found.height is not None:
                own[2] = np.nan_to_num(found.height)
            own[3] = 0.0 if found.amplitude is None else found.amplitude
            own[4] = index
    x, y, z, amplitude, indices = points
    columns = {"x": x, "y": y, "z": z, "amplitude": amplitude}
    columns["radar_index"] = indices.astype(np.int64)
    return point_cloud.to_cdr(scan.stamp_ns, frame, columns)


class Mounting(NamedTuple):
    """The pose of a frame in the world frame."""

    frame: str
    position: tuple[float, float]  # Metres
    yaw: float  # Radians, counter-clockwise


def frames_to_cdr(mountings: Sequence[Mounting], stamp_ns: int, world_frame: str) -> bytes:
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


# Density of the value 0, number of values per factor of ten, and largest value.
LEAST_DENSITY, PER_DECADE, MOST_VALUE = 0.01, 20.0, 100


def clutter_to_msg(raster: ClutterRaster, stamp_ns: int, world_frame: str) -> OccupancyGrid:
    """Return the message of a clutter map in the world frame."""
    rows, columns = raster.density.shape
    value = PER_DECADE * np.log10(np.maximum(raster.density, LEAST_DENSITY) / LEAST_DENSITY)
    data = np.minimum(np.round(value), MOST_VALUE).astype(np.int8)
    x, y = raster.corner
    header = stamps.header(stamp_ns, world_frame)
    info = MapMetaData(
        map_load_time=header.stamp, resolution=raster.cell, width=columns, height=rows
    )
    info.origin = Pose(position=Point(x=x, y=y, z=0.0), orientation=Quaternion(w=1.0))
    message = OccupancyGrid(header=header, info=info)
    message.data.frombytes(data.tobytes())
    return message


def clutter_from_msg(message: OccupancyGrid) -> ClutterRaster:
    """Return the clutter map of a message, with the densities of its values.

    Raise `RejectedMessageError`: ``schema`` if its size does not match its data or is absurd;
    ``not_finite`` if its origin or resolution is not finite.
    """
    info = message.info
    rows, columns, cell = int(info.height), int(info.width), float(info.resolution)
    # Upper bound of the cells of a map.
    if not 0 < rows * columns == len(message.data) <= 1 << 22:
        raise RejectedMessageError(
            "schema", f"{len(message.data)} values for {columns} by {rows} cells"
        )
    corner = float(info.origin.position.x), float(info.origin.position.y)
    if not (np.isfinite(corner).all() and np.isfinite(cell) and cell > 0.0):
        raise RejectedMessageError("not_finite", f"origin {corner}, resolution {cell}")
    value = np.array(message.data, dtype=float).reshape(rows, columns)
    density = np.where(value > 0.0, LEAST_DENSITY * 10.0 ** (value / PER_DECADE), 0.0)
    return ClutterRaster(corner, cell, density)
