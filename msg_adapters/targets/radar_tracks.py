"""Estimates as ``radar_msgs/RadarTracks``, which is not part of every ROS installation."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Vector3

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from ..encoding import interfaces, names, stamps
from . import vertical

# First number that the message's definition reserves for a user's own classifications.
FIRST_OWN_CLASSIFICATION = 32000


def to_msg(
    estimates: Estimates,
    frame: str,
    run: uuid.UUID,
    message_class: Callable[[str], Any] = interfaces.message_class,
) -> Any:
    """Encode one set of estimates, empty or not.

    Class k has the classification 32000 + k. Quantities that are not estimated are zero:
    acceleration, size, unknown heights, and their covariances.

    A target keeps its identifier within a tracker's `run`, and different runs have different
    identifiers. An unlabelled target gets a new identifier in every message.
    """
    message = message_class(names.RADAR_TRACKS)(header=stamps.header(estimates.stamp_ns, frame))
    up = vertical.of(estimates)
    for row, label in enumerate(estimates.track_id.tolist()):
        state, covariance = estimates.state[row].tolist(), estimates.covariance[row]
        height, climb = map(float, up.state[row])
        name = str(label) if label else f"{estimates.stamp_ns} {row}"
        track = message_class("radar_msgs/msg/RadarTrack")()
        track.uuid.uuid = np.frombuffer(uuid.uuid5(run, name).bytes, dtype=np.uint8)
        track.position = Point(x=state[X], y=state[Y], z=height)
        track.velocity = Vector3(x=state[VX], y=state[VY], z=climb)
        track.classification = FIRST_OWN_CLASSIFICATION + int(estimates.class_id[row])
        track.position_covariance = _upper_triangle(covariance, (X, Y), up.covariance[row, 0, 0])
        track.velocity_covariance = _upper_triangle(covariance, (VX, VY), up.covariance[row, 1, 1])
        message.tracks.append(track)
    return message


def _upper_triangle(covariance: FloatArray, plane: tuple[int, int], upward: float) -> Any:
    """Return the terms xx, xy, xz, yy, yz, zz of a covariance, as float32."""
    x, y = plane
    terms = [covariance[x, x], covariance[x, y], 0.0, covariance[y, y], 0.0, upward]
    return np.array(terms, dtype=np.float32)
