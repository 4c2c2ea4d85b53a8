"""The detections of all radars in the world frame, as one point cloud for viewers.

Drivers differ in field names, units and frames; this cloud is uniform for all radars.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import Scan

from ..encoding import point_cloud


def to_cdr(scan: Scan, radars: Sequence[Sensor], frame: str) -> bytes:
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
