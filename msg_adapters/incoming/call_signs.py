"""Reads the call signs of aircraft from clouds with the fields of `asterix_bridge`."""

from __future__ import annotations

from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.asterix.messages import CallSigns
from phd_jdtc_ros.columns.identities import NONE

from ..encoding import interfaces, names, point_cloud
from ..encoding.errors import RejectedMessageError

FIELDS = ("address", "call_sign_high", "call_sign_low")


def learn_from_cdr(data: bytes, call_signs: CallSigns) -> None:
    """Add the call signs of a recorded cloud; an unreadable one has none."""
    if FIELDS[1].encode() not in data:
        return
    try:
        learn(interfaces.decode(data, names.CLOUD), call_signs)
    except RejectedMessageError:  # its fault is reported where its detections are read
        return


def learn(cloud: PointCloud2, call_signs: CallSigns) -> None:
    """Add the call signs of a cloud, which has none unless `asterix_bridge` made it."""
    if not {*FIELDS} <= {*point_cloud.field_names(cloud)}:
        return
    found = point_cloud.decode(cloud, dict.fromkeys(FIELDS, point_cloud.UNSIGNED))
    for address, high, low in zip(*(found[name].tolist() for name in FIELDS), strict=True):
        if NONE not in (address, high, low):
            call_signs.take(address, (high & 0xFFFFFF) << 24 | low & 0xFFFFFF)
