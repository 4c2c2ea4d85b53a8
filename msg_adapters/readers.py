# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The readers of radar messages, by the name of the message type in a configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.core.configuration.radar_input import RadarInput

from . import detections, interfaces, names, radar_scan
from .detections import Report


@dataclass(frozen=True)
class Reader:
    """The conversion of one type of message to detections.

    Parameters
    ----------
    type_name : str
        Such as ``sensor_msgs/msg/PointCloud2``.
    from_msg : callable
        Converts a message, with the radar's input, to a `Report`; raises `RejectedMessageError`.
    from_cdr : callable
        As `from_msg`, for the bytes of a recorded message; its package need not be installed.
    """

    type_name: str
    from_msg: Callable[[Any, RadarInput], Report]
    from_cdr: Callable[[bytes, RadarInput], Report]

    def installed(self) -> Any:
        """Return the message class, or None if its package is not installed."""
        try:
            return interfaces.message_class(self.type_name)
        except ImportError:
            return None


def _cloud_from_cdr(data: bytes, radar: RadarInput) -> Report:
    return detections.from_msg(interfaces.decode(data, names.CLOUD), radar)


READERS = {
    "point_cloud": Reader(names.CLOUD, detections.from_msg, _cloud_from_cdr),
    "radar_scan": Reader(radar_scan.TYPE_NAME, radar_scan.from_msg, radar_scan.from_cdr),
}


def reader_of(radar: RadarInput) -> Reader:
    """Return the reader of a radar's messages."""
    return READERS[radar.message]
