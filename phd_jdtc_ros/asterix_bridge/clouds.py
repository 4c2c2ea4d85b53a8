"""Converts sectors and slices of plots to clouds."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros.asterix.columns import UNKNOWN, columns
from phd_jdtc_ros.asterix.plot_stream import RadarState
from phd_jdtc_ros.asterix.slices import SectorReport


def cloud(report: SectorReport, radar: RadarState) -> PointCloud2:
    """Return the cloud of a sector or a slice, in the frame with the radar's name.

    The fields are those of `columns`. All are FLOAT32, except for ``code address call_sign_high
    call_sign_low sector`` (UINT32) and ``kind`` (UINT8). All clouds of a radar with sectors have
    that field; in a slice it is `UNKNOWN`.
    """
    settings = radar.settings
    found = columns(report, settings.sectors)
    if radar.assembler.has_sectors and report.sector is None:
        found["sector"] = np.full(len(report.plots), UNKNOWN, dtype=np.uint32)
    return point_cloud.encode(report.stamp_ns, settings.name, found)
