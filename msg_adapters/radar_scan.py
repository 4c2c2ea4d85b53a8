# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A ``radar_msgs/RadarScan`` to `Detections`.

radar_msgs is not part of every ROS installation. It is not imported here; the tracker asks for the
message class only if a radar is configured to send it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from phd_jdtc_ros.core.configuration.radar_input import RadarInput

from . import interfaces
from .detections import Report, require_frame, select, stamp_of
from .errors import RejectedMessageError
from .point_cloud import MAX_POINTS

TYPE_NAME = "radar_msgs/msg/RadarScan"


def installed() -> Any:
    """Return the message class, or None if radar_msgs is not installed."""
    try:
        return interfaces.message_class(TYPE_NAME)
    except ImportError:
        return None


def from_msg(scan: Any, radar: RadarInput) -> Report:
    """Return the detections of a scan.

    The message fixes what a point cloud leaves to its driver: azimuths are counter-clockwise from
    the sensor's x axis, amplitudes are in dB, and there is an elevation (0 for a planar radar).

    Parameters
    ----------
    scan : radar_msgs.msg.RadarScan
    radar : RadarInput
        Its frame, its range limit and `amplitude_offset_db`, which turns the amplitudes into SNRs,
        are used. Without an `amplitude_field` the amplitudes are ignored.

    Raises
    ------
    RejectedMessageError
        ``frame`` if the scan is in another frame than the radar's; ``oversize`` above
        `point_cloud.MAX_POINTS` returns; ``schema`` if the stamp is not valid, see
        `detections.stamp_of`.
    """
    require_frame(scan.header.frame_id, radar)
    if len(scan.returns) > MAX_POINTS:
        raise RejectedMessageError(
            "oversize", f"{len(scan.returns)} returns, at most {MAX_POINTS} are allowed"
        )
    rows = np.array(
        [(r.range, r.azimuth, r.elevation, r.amplitude) for r in scan.returns], dtype=np.float64
    ).reshape(-1, 4)
    return select(
        stamp_of(scan.header),
        replace(radar, amplitude_in_db=True, compass=False),
        distance=rows[:, 0],
        azimuth=rows[:, 1],
        elevation=rows[:, 2],
        level=rows[:, 3] if radar.amplitude_field else None,
    )
