"""The readers of the sensors' messages by their configured names, and call signs in clouds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.asterix.messages import CallSigns
from phd_jdtc_ros.columns.identities import NONE
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.types import Detections

from ..encoding import RejectedMessageError, interfaces, names, point_cloud
from . import detections, positions, radar_scan, vision


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
    "detections_3d": Reader(names.DETECTIONS_3D, vision.from_msg, vision.from_cdr, vision.to_cdr),
}


def reader_of(sensor: SensorParameters) -> Reader:
    """Return the decoder and encoder of a sensor's messages."""
    return READERS[sensor.message]


CALL_SIGN_FIELDS = ("address", "call_sign_high", "call_sign_low")


def learn_call_signs_from_cdr(data: bytes, call_signs: CallSigns) -> None:
    """Add the call signs of a recorded cloud; an unreadable one has none."""
    if CALL_SIGN_FIELDS[1].encode() not in data:
        return
    try:
        learn_call_signs(interfaces.decode(data, names.CLOUD), call_signs)
    except RejectedMessageError:  # Its fault is reported where its detections are read
        return


def learn_call_signs(cloud: PointCloud2, call_signs: CallSigns) -> None:
    """Add the call signs of a cloud, which has none unless `asterix_bridge` made it."""
    if not {*CALL_SIGN_FIELDS} <= {*point_cloud.field_names(cloud)}:
        return
    found = point_cloud.decode(cloud, dict.fromkeys(CALL_SIGN_FIELDS, point_cloud.UNSIGNED))
    for address, high, low in zip(
        *(found[name].tolist() for name in CALL_SIGN_FIELDS), strict=True
    ):
        if NONE not in (address, high, low):
            call_signs.take(address, (high & 0xFFFFFF) << 24 | low & 0xFFFFFF)
