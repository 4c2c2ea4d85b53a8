"""Converts sectors and slices of plots to clouds."""

from __future__ import annotations

from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros.asterix.call_signs import CallSigns
from phd_jdtc_ros.asterix.columns import UNKNOWN, columns
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


def learn_call_signs(cloud: PointCloud2, call_signs: CallSigns) -> None:
    """Add the call signs of a cloud, which has none unless `cloud` made it."""
    wanted = ("address", "call_sign_high", "call_sign_low")
    if not {*wanted} <= {*point_cloud.field_names(cloud)}:
        return
    found = point_cloud.decode(cloud, dict.fromkeys(wanted, point_cloud.UNSIGNED))
    for address, high, low in zip(*(found[name].tolist() for name in wanted), strict=True):
        if UNKNOWN not in (address, high, low):
            call_signs.take(address, (high & 0xFFFFFF) << 24 | low & 0xFFFFFF)
