"""``vision_msgs/Detection3DArray`` of a detector as the positions of a sensor.

vision_msgs is optional, and this module does not import it. Its messages need the package, live and
recorded.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from phd_jdtc_ros.columns.position_selection import select
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.core.types import Detections

from ..encoding import RejectedMessageError, interfaces, names, stamps
from ..encoding.point_cloud import MAX_POINTS
from .detections import require_frame

COLUMNS = ("x", "y", "z", "x_std", "y_std", "z_std", "correlation")
# Places of the variances of x, y and z in a covariance of 6 x 6, and of the covariance of x and y.
VARIANCES, ACROSS = (0, 7, 14), 1


def from_msg(message: Any, own: PositionParameters) -> Report:
    """Return the detections of a message: the places of objects, with their covariances.

    A place is that of the most probable hypothesis if this has a covariance, otherwise the centre
    of the bounding box, or that of the hypothesis if the box was never set.

    Raise `RejectedMessageError`: ``frame`` if the message is in another frame than the sensor's;
    ``oversize`` above `point_cloud.MAX_POINTS` detections; otherwise see `stamps.of_input`.
    """
    require_frame(message.header.frame_id, own)
    count = len(message.detections)
    if count > MAX_POINTS:
        text = f"{count} detections, at most {MAX_POINTS} are allowed"
        raise RejectedMessageError("oversize", text)
    rows = np.array([_row(each) for each in message.detections]).reshape(-1, len(COLUMNS))
    return select(stamps.of_input(message.header), own, dict(zip(COLUMNS, rows.T, strict=True)))


def from_cdr(data: bytes, own: PositionParameters) -> Report:
    """Decode a recorded message as `from_msg` does."""
    return from_msg(interfaces.decode(data, names.DETECTIONS_3D), own)


def to_cdr(detections: Detections, stamp_ns: int, own: PositionParameters) -> bytes:
    """Serialise detections as the centres of bounding boxes."""
    header = stamps.header(stamp_ns, own.frame)
    message = interfaces.message_class(names.DETECTIONS_3D)(header=header)
    height = np.zeros(len(detections)) if detections.z is None else detections.z - own.height
    for (x, y), z in zip(detections.measurement.tolist(), height.tolist(), strict=True):
        detection = interfaces.message_class(names.DETECTION_3D)(header=header)
        place = detection.bbox.center.position
        place.x, place.y, place.z = x, y, z
        message.detections.append(detection)
    return interfaces.encode(message)


def _row(detection: Any) -> tuple[float, ...]:
    """Return `COLUMNS` of a detection; NaN where they are unknown."""
    box, unknown = detection.bbox, math.nan
    place = box.center.position
    best = max(detection.results, key=lambda each: float(each.hypothesis.score), default=None)
    if best is None:
        return place.x, place.y, place.z, unknown, unknown, unknown, unknown
    covariance = best.pose.covariance
    variances = [float(covariance[index]) for index in VARIANCES]
    std = [math.sqrt(each) if each > 0.0 else unknown for each in variances]
    known = math.isfinite(std[0]) and math.isfinite(std[1])
    sides = (place.x, place.y, place.z, box.size.x, box.size.y, box.size.z)
    if known or not any(sides):
        place = best.pose.pose.position
    correlation = float(covariance[ACROSS]) / (std[0] * std[1]) if known else unknown
    return place.x, place.y, place.z, *std, correlation
