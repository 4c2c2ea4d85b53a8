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
    (UINT32, from 0 in the configured order). z is the height, 0 if unknown. The amplitude is 0 if
    the radar reports none, because viewers draw NaN in an undefined colour.
    """
    parts = [np.zeros((0, 5))]
    for index, (radar, found) in enumerate(zip(radars, scan.detections, strict=True)):
        if found is not None:
            none = np.zeros(len(found))
            x, y = radar.at(found.pose).to_world(found.measurement).T
            z = none if found.height is None else np.nan_to_num(found.height)
            amplitude = none if found.amplitude is None else found.amplitude
            parts.append(np.column_stack([x, y, z, amplitude, none + index]))
    x, y, z, amplitude, indices = np.concatenate(parts).T
    columns = {"x": x, "y": y, "z": z, "amplitude": amplitude}
    columns["radar_index"] = indices.astype(np.int64)
    return point_cloud.to_cdr(scan.stamp_ns, frame, columns)
