"""Reports of plots and positions as clouds, in the frames of their radars."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names, point_cloud
from phd_jdtc_ros.asterix.assembly import SectorReport
from phd_jdtc_ros.asterix.messages import ADS_B, NONE, Plot
from phd_jdtc_ros.asterix.plot_stream import Cloud, RadarState
from phd_jdtc_ros.transponders import stream
from phd_jdtc_ros.transponders.stream import UNKNOWN, Batch

# Level of a receiver's noise that amplitudes are converted with, dBm. The tracker's parameter
# `amplitude_offset_db` corrects it for a radar.
NOISE_DBM = -100.0


def columns(report: SectorReport, sectors: int) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a cloud in their order, arrays of shape (M,).

    `sectors` is the number of sectors per revolution, a multiple of 4. An amplitude of s dBm, of
    the echo or else of the replies, becomes an envelope of ``sqrt(2 * 10^((s - NOISE_DBM) / 10))``
    in units of the noise's standard deviation per quadrature component.

    The columns are ``x y z`` in the frame of the radar, whose x axis is east; ``range`` (slant, m),
    ``azimuth`` (rad counter-clockwise from the x axis), ``elevation`` (0), ``amplitude`` (NaN if
    unknown), ``time`` (s relative to the stamp), ``height`` (m, NaN if unknown), ``code`` and
    ``address`` (`UNKNOWN` if unknown), and ``kind`` (the TYP of I048/020). If any call sign is
    known, ``call_sign_high`` and ``call_sign_low`` follow, 24 bits each (`UNKNOWN` if unknown). If
    the sector is known, ``sector`` follows, counted counter-clockwise from the x axis like
    azimuths.
    """
    plots = report.plots
    fields = dict(zip(Plot._fields, zip(*plots, strict=True), strict=True)) if plots else {}

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(fields.get(name, ()), dtype=np.float64)

    distance, compass = column("distance"), column("azimuth")
    azimuth = math.pi - np.remainder(compass + 0.5 * math.pi, 2.0 * math.pi)
    zero = np.zeros(len(plots))
    echoes, replies = column("primary_dbm"), column("secondary_dbm")
    times = np.array([time - report.stamp_ns for time in report.times_ns], dtype=np.float64)
    found: dict[str, npt.NDArray[Any]] = {
        "x": distance * np.cos(azimuth),
        "y": distance * np.sin(azimuth),
        "z": zero,
        "range": distance,
        "azimuth": azimuth,
        "elevation": zero,
        "amplitude": _amplitude(np.where(np.isnan(echoes), replies, echoes)),
        "time": times * 1e-9,
        "height": column("height"),
        "code": _identity(column("code")),
        "address": _identity(column("address")),
        "kind": column("detection_type").astype(np.uint8),
    }
    signs = np.array(fields.get("call_sign", ()), dtype=np.int64)
    if (signs != NONE).any():
        found["call_sign_high"] = np.where(signs == NONE, UNKNOWN, signs >> 24).astype(np.uint32)
        low = np.where(signs == NONE, UNKNOWN, signs & 0xFFFFFF)
        found["call_sign_low"] = low.astype(np.uint32)
    if report.sector is not None:
        own = (sectors // 4 - 1 - report.sector) % sectors
        found["sector"] = np.full(len(plots), own, dtype=np.uint32)
    return found


def _amplitude(level_dbm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    envelope: npt.NDArray[np.float64] = np.sqrt(2.0 * 10.0 ** ((level_dbm - NOISE_DBM) / 10.0))
    return envelope


def _identity(given: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]:
    return np.where(given == NONE, UNKNOWN, given).astype(np.uint32)


def topic_of(report: Cloud, radar: RadarState) -> str:
    """Return the topic of a cloud: that of a radar's detections, or of reports."""
    name = radar.settings.name
    return names.reports(name) if isinstance(report, Batch) else names.detections(name)


def cloud_of(report: Cloud, radar: RadarState) -> PointCloud2:
    """Return the cloud of a sector, a slice or a batch, in the frame with the radar's name.

    Those of positions are `stream.columns`, with ellipses unless they are from ADS-B.

    The fields are those of `columns`. All are FLOAT32, except for ``code address call_sign_high
    call_sign_low sector`` (UINT32) and ``kind`` (UINT8). All clouds of a radar with sectors have
    that field; in a slice it is `UNKNOWN`.
    """
    settings = radar.settings
    if isinstance(report, Batch):
        positions = stream.columns(report, radar.source != ADS_B)
        return point_cloud.encode(report.stamp_ns, settings.name, positions, stream.WIDE)
    found = columns(report, settings.sectors)
    if radar.assembler.has_sectors and report.sector is None:
        found["sector"] = np.full(len(report.plots), UNKNOWN, dtype=np.uint32)
    return point_cloud.encode(report.stamp_ns, settings.name, found)
