"""Estimates as ``vision_msgs/Detection3DArray``, which is not part of every ROS installation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovariance

from phd_jdtc_ros.core.types import Estimates

from ..encoding import interfaces, names, stamps
from . import vertical
from .tracks import pose_of


def to_msg(
    estimates: Estimates,
    frame: str,
    class_names: Sequence[str],
    message_class: Callable[[str], Any] = interfaces.message_class,
) -> Any:
    """Encode one set of estimates, empty or not.

    Every target has one hypothesis per class, the most probable first, with the class's probability
    as its score. Its `id` is the track id, empty if it has none. The pose faces along the velocity,
    and only the position's terms of its covariance are set. Boxes have no size, because targets are
    points. `class_names` are by class id.
    """
    header, up = stamps.header(estimates.stamp_ns, frame), vertical.of(estimates)
    message = message_class(names.DETECTIONS_3D)(header=header)
    for row, label in enumerate(estimates.track_id.tolist()):
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = estimates.position_covariance[row]
        covariance[2, 2] = up.covariance[row, 0, 0]
        pose = PoseWithCovariance(
            pose=pose_of(estimates.state[row], float(up.state[row, 0])),
            covariance=covariance.ravel(),
        )
        detection = message_class("vision_msgs/msg/Detection3D")(header=header)
        detection.id = str(label) if label else ""
        detection.bbox.center = pose.pose
        probability = estimates.class_probability[row]
        for class_id in np.argsort(-probability, kind="stable"):
            result = message_class("vision_msgs/msg/ObjectHypothesisWithPose")()
            result.hypothesis.class_id = class_names[class_id]
            result.hypothesis.score = float(probability[class_id])
            result.pose = pose
            detection.results.append(result)
        message.detections.append(detection)
    return message
