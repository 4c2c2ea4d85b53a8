"""Estimates as the objects of driving stacks: Autoware, Nav2's dynamic obstacles, derived objects.

Their classes are numbers. A class of the tracker has the number of the kind of its name, such as
``car`` or ``pedestrian``, and is unknown if no kind has it. Boxes have no size, because targets are
points.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Twist, Vector3

from phd_jdtc_ros.core.state_space import OMEGA, VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from ..encoding import interfaces, names, stamps
from . import vertical
from .tracks import UNKNOWN_VARIANCE, identifier, pose_and_twist, pose_of

# The numbers of kinds in ``autoware_perception_msgs/ObjectClassification``, and in
# ``derived_object_msgs/Object``.
AUTOWARE = {
    **{"unknown": 0, "car": 1, "truck": 2, "bus": 3, "trailer": 4, "motorcycle": 5},
    **{"bicycle": 6, "pedestrian": 7, "animal": 8},
}
DERIVED = {
    **{"unknown": 0, "pedestrian": 4, "bicycle": 5, "bike": 5, "car": 6, "truck": 7},
    **{"motorcycle": 8, "vehicle": 9},
}
# Availability of the orientation: that of the velocity is known with its sign.
AVAILABLE, TRACKED = 2, 1
Classes = Callable[[str], Any]


def to_tracked_objects(
    estimates: Estimates,
    frame: str,
    class_names: Sequence[str],
    run: uuid.UUID,
    message_class: Classes = interfaces.message_class,
) -> Any:
    """Encode estimates as ``autoware_perception_msgs/TrackedObjects``.

    The pose faces along the velocity, and the twist is in its frame, as Autoware wants it.
    """
    message = message_class(names.TRACKED_OBJECTS)(header=stamps.header(estimates.stamp_ns, frame))
    up = vertical.of(estimates)
    for row in range(len(estimates)):
        one = message_class("autoware_perception_msgs/msg/TrackedObject")()
        one.object_id.uuid = identifier(estimates, row, run)
        one.existence_probability = min(float(estimates.existence[row]), 1.0)
        for name, share in zip(class_names, estimates.class_probability[row].tolist(), strict=True):
            kind = message_class("autoware_perception_msgs/msg/ObjectClassification")()
            kind.label, kind.probability = AUTOWARE.get(name, 0), share
            one.classification.append(kind)
        kinematics = one.kinematics
        kinematics.pose_with_covariance, kinematics.twist_with_covariance = pose_and_twist(
            estimates, row, up
        )
        kinematics.orientation_availability = AVAILABLE
        message.objects.append(one)
    return message


def to_obstacles(
    estimates: Estimates,
    frame: str,
    run: uuid.UUID,
    message_class: Classes = interfaces.message_class,
) -> Any:
    """Encode estimates as ``nav2_dynamic_msgs/ObstacleArray``; the score is that of existence.

    Covariances, of x, y and z, are there since the package's version of 2024; unknown heights have
    the variance `UNKNOWN_VARIANCE`.
    """
    message = message_class(names.OBSTACLES)(header=stamps.header(estimates.stamp_ns, frame))
    up = vertical.of(estimates)
    for row, state in enumerate(estimates.state.tolist()):
        one = message_class("nav2_dynamic_msgs/msg/Obstacle")()
        one.uuid.uuid = identifier(estimates, row, run)
        one.score = min(float(estimates.existence[row]), 1.0)
        one.position = Point(x=state[X], y=state[Y], z=float(up.state[row, 0]))
        one.velocity = Vector3(x=state[VX], y=state[VY], z=float(up.state[row, 1]))
        if isinstance(getattr(one, "position_covariance", None), np.ndarray):
            for axis, name in enumerate(("position_covariance", "velocity_covariance")):
                covariance = np.diag([0.0, 0.0, UNKNOWN_VARIANCE])
                if up.known[row]:
                    covariance[2, 2] = up.covariance[row, axis, axis]
                covariance[:2, :2] = getattr(estimates, name)[row]
                setattr(one, name, covariance.ravel())
        message.obstacles.append(one)
    return message


def to_derived_objects(
    estimates: Estimates,
    frame: str,
    class_names: Sequence[str],
    message_class: Classes = interfaces.message_class,
) -> Any:
    """Encode estimates with a track number as ``derived_object_msgs/ObjectArray``.

    The twist is in the world frame, and the certainty of the class is of 255.
    """
    header, up = stamps.header(estimates.stamp_ns, frame), vertical.of(estimates)
    message = message_class(names.DERIVED_OBJECTS)(header=header)
    for row in np.flatnonzero(estimates.track_id).tolist():
        state, class_id = estimates.state[row], int(estimates.class_id[row])
        one = message_class("derived_object_msgs/msg/Object")(header=header)
        one.id, one.detection_level = int(estimates.track_id[row]), TRACKED
        one.pose = pose_of(state, float(up.state[row, 0]))
        one.twist = Twist()
        one.twist.linear = Vector3(
            x=float(state[VX]), y=float(state[VY]), z=float(up.state[row, 1])
        )
        one.twist.angular.z = float(state[OMEGA])
        one.classification = DERIVED.get(class_names[class_id], 0)
        one.object_classified = one.classification > 0
        share = min(float(estimates.class_probability[row, class_id]), 1.0)
        one.classification_certainty = round(255.0 * share)
        message.objects.append(one)
    return message
