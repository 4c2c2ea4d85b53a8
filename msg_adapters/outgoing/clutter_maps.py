"""Clutter maps as ``nav_msgs/OccupancyGrid``, with densities on a logarithmic scale.

A factor of ten is 20 steps: 0 stands for at most 0.01 false detections per revolution and km^2, 100
for 1000 or more.
"""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid

from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster

from ..encoding import stamps
from ..encoding.errors import RejectedMessageError

# Density of the value 0, number of values per factor of ten, and largest value.
LEAST_DENSITY, PER_DECADE, MOST_VALUE = 0.01, 20.0, 100
# Upper bound of the cells of a map.
MOST_CELLS = 1 << 22


def to_msg(raster: ClutterRaster, stamp_ns: int, world_frame: str) -> OccupancyGrid:
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


def from_msg(message: OccupancyGrid) -> ClutterRaster:
    """Return the clutter map of a message, with the densities of its values.

    Raise `RejectedMessageError`: ``schema`` if its size does not match its data or is absurd;
    ``not_finite`` if its origin or resolution is not finite.
    """
    info = message.info
    rows, columns, cell = int(info.height), int(info.width), float(info.resolution)
    if not 0 < rows * columns == len(message.data) <= MOST_CELLS:
        raise RejectedMessageError(
            "schema", f"{len(message.data)} values for {columns} by {rows} cells"
        )
    corner = float(info.origin.position.x), float(info.origin.position.y)
    if not (np.isfinite(corner).all() and np.isfinite(cell) and cell > 0.0):
        raise RejectedMessageError("not_finite", f"origin {corner}, resolution {cell}")
    value = np.array(message.data, dtype=float).reshape(rows, columns)
    density = np.where(value > 0.0, LEAST_DENSITY * 10.0 ** (value / PER_DECADE), 0.0)
    return ClutterRaster(corner, cell, density)
