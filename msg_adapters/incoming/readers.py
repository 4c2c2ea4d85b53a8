"""The supported detection messages, by their configured name, with decoders and encoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.types import Detections

from ..encoding import interfaces, names
from . import detections, positions, radar_scan


@dataclass(frozen=True)
class Reader:
    """Decoder and encoder of one message of a kind of sensor."""

    type_name: str  # Such as ``sensor_msgs/msg/PointCloud2``
    # Decodes a message to a `Report`, given the sensor's parameters; raises `RejectedMessageError`.
    from_msg: Callable[[Any, Any], Report]
    # Decodes a recorded message's bytes likewise; the message's package need not be installed.
    from_cdr: Callable[[bytes, Any], Report]
    # Encodes detections, given a stamp and the sensor's parameters.
    to_cdr: Callable[[Detections, int, Any], bytes]
    # Definition and hash of the type, for bags; empty if they come from the installed package.
    definition: str = ""
    type_hash: str = ""


READERS = {
    "point_cloud": Reader(
        names.CLOUD,
        detections.from_msg,
        lambda data, radar: detections.from_msg(interfaces.decode(data, names.CLOUD), radar),
        lambda found, stamp_ns, radar: interfaces.encode(
            detections.to_msg(found, stamp_ns, radar.frame, radar)
        ),
    ),
    "radar_scan": Reader(
        radar_scan.TYPE_NAME,
        radar_scan.from_msg,
        radar_scan.from_cdr,
        radar_scan.to_cdr,
        radar_scan.DEFINITION,
        radar_scan.TYPE_HASH,
    ),
    "positions": Reader(
        names.CLOUD,
        positions.from_msg,
        lambda data, sensor: positions.from_msg(interfaces.decode(data, names.CLOUD), sensor),
        positions.to_cdr,
    ),
}


def reader_of(sensor: SensorParameters) -> Reader:
    """Return the decoder and encoder of a sensor's messages."""
    return READERS[sensor.message]
