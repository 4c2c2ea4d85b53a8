"""Estimates as ``vision_msgs/Detection3DArray``.

vision_msgs is not part of every ROS installation, so its classes are passed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseWithCovariance

from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from . import interfaces, stamps, vertical
from .estimates import heading


class Types(NamedTuple):
    """The message classes of `message_types`."""

    detections: Any
    detection: Any
    hypothesis: Any


def message_types() -> Types:
    """Return the message classes; raise ImportError if vision_msgs is not installed."""
    return Types(
        interfaces.message_class("vision_msgs/msg/Detection3DArray"),
        interfaces.message_class("vision_msgs/msg/Detection3D"),
        interfaces.message_class("vision_msgs/msg/ObjectHypothesisWithPose"),
    )


def to_msg(estimates: Estimates, frame: str, class_names: Sequence[str], types: Types) -> Any:
    """Encode one set of estimates, empty or not.

    Every target has one hypothesis per class, the most probable first, with the class's probability
    as its score. Its `id` is the track id, empty if it has none. The pose faces along the velocity,
    and only the position's terms of its covariance are set. Boxes have no size, because targets are
    points.

    Parameters
    ----------
    class_names : sequence of str
        Names by class id.
    """
    message = types.detections(header=stamps.header(estimates.stamp_ns, frame))
    message.detections = [
        _detection(estimates, row, frame, class_names, types) for row in range(len(estimates))
    ]
    return message


def _detection(
    estimates: Estimates, row: int, frame: str, class_names: Sequence[str], types: Types
) -> Any:
    pose = _pose(estimates, row)
    probability = estimates.class_probability[row]
    label = int(estimates.track_id[row])
    detection = types.detection(header=stamps.header(estimates.stamp_ns, frame))
    detection.id = str(label) if label else ""
    detection.bbox.center = pose.pose
    for class_id in np.argsort(-probability, kind="stable"):
        hypothesis = types.hypothesis()
        hypothesis.hypothesis.class_id = class_names[class_id]
        hypothesis.hypothesis.score = float(probability[class_id])
        hypothesis.pose = pose
        detection.results.append(hypothesis)
    return detection


def _pose(estimates: Estimates, row: int) -> PoseWithCovariance:
    state = estimates.state[row]
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = estimates.position_covariance[row]
    up = vertical.of(estimates)
    covariance[2, 2] = up.covariance[row, 0, 0]
    return PoseWithCovariance(
        pose=Pose(
            position=Point(x=float(state[X]), y=float(state[Y]), z=float(up.state[row, 0])),
            orientation=heading(state[VX], state[VY]),
        ),
        covariance=covariance.ravel(),
    )
