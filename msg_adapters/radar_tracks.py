"""Estimates as ``radar_msgs/RadarTracks``.

radar_msgs is not part of every ROS installation, so its classes are passed in.
"""

from __future__ import annotations

import uuid
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Vector3

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from . import interfaces, stamps, vertical

# First number that the message's definition reserves for a user's own classifications.
FIRST_OWN_CLASSIFICATION = 32000


class Types(NamedTuple):
    """The message classes of `message_types`."""

    tracks: Any
    track: Any


def message_types() -> Types:
    """Return the message classes; raise ImportError if radar_msgs is not installed."""
    return Types(
        interfaces.message_class("radar_msgs/msg/RadarTracks"),
        interfaces.message_class("radar_msgs/msg/RadarTrack"),
    )


def to_msg(estimates: Estimates, frame: str, run: uuid.UUID, types: Types) -> Any:
    """Encode one set of estimates, empty or not.

    Class k has the classification 32000 + k. Quantities that are not estimated are zero:
    acceleration, size, unknown heights, and their covariances.

    Parameters
    ----------
    run : uuid.UUID
        Identifies the tracker's run. A target keeps its identifier within a run, and different runs
        have different identifiers. An unlabelled target gets a new identifier in every message.
    """
    message = types.tracks(header=stamps.header(estimates.stamp_ns, frame))
    up = vertical.of(estimates)
    message.tracks = [_track(estimates, row, run, types, up) for row in range(len(estimates))]
    return message


def _track(
    estimates: Estimates, row: int, run: uuid.UUID, types: Types, up: vertical.Vertical
) -> Any:
    state, covariance = estimates.state[row], estimates.covariance[row]
    label = int(estimates.track_id[row])
    name = str(label) if label else f"{estimates.stamp_ns} {row}"
    track = types.track()
    track.uuid.uuid = np.frombuffer(uuid.uuid5(run, name).bytes, dtype=np.uint8)
    height, climb = map(float, up.state[row])
    track.position = Point(x=float(state[X]), y=float(state[Y]), z=height)
    track.velocity = Vector3(x=float(state[VX]), y=float(state[VY]), z=climb)
    track.classification = FIRST_OWN_CLASSIFICATION + int(estimates.class_id[row])
    track.position_covariance = _upper_triangle(covariance, (X, Y), up.covariance[row, 0, 0])
    track.velocity_covariance = _upper_triangle(covariance, (VX, VY), up.covariance[row, 1, 1])
    return track


def _upper_triangle(covariance: FloatArray, plane: tuple[int, int], upward: float) -> Any:
    """Return the terms xx, xy, xz, yy, yz, zz of a covariance, as float32."""
    x, y = plane
    terms = [covariance[x, x], covariance[x, y], 0.0, covariance[y, y], 0.0, upward]
    return np.array(terms, dtype=np.float32)
