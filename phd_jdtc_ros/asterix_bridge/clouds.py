"""Converts sectors and slices of plots to clouds."""

from __future__ import annotations

from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros.asterix.columns import columns
from phd_jdtc_ros.asterix.plot_stream import RadarSettings
from phd_jdtc_ros.asterix.slices import SectorReport

from .settings import Amplitudes


def cloud(report: SectorReport, radar: RadarSettings, amplitudes: Amplitudes) -> PointCloud2:
    """Return the cloud of a sector or a slice, in the frame with the radar's name.

    The fields are those of `columns`. All are FLOAT32, except for ``code address call_sign_high
    call_sign_low sector`` (UINT32) and ``kind`` (UINT8).
    """
    found = columns(report, radar.sectors, amplitudes.noise_dbm, amplitudes.choice)
    return point_cloud.encode(report.stamp_ns, radar.name, found)
