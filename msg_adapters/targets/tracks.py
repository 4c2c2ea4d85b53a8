"""Tracks as odometry and as paths, for consumers that follow individual targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry, Path

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.state_space import OMEGA, VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from ..encoding import stamps
from . import vertical

# Variance of quantities that a planar track does not estimate: height, roll, pitch and their rates.
UNKNOWN_VARIANCE = 1e6
# Variance of an angle that is uniform over the circle.
LARGEST_YAW_VARIANCE = math.pi**2 / 3.0


@dataclass(frozen=True)
class Waypoint:
    """A track's state at one time."""

    stamp_ns: int
    state: FloatArray  # (D,)
    height: float = math.nan  # Height above the world's zero, metres; NaN if unknown


def rows_by_track(estimates: Estimates) -> list[tuple[int, int]]:
    """Return the (track, row) pairs of the labelled estimates, by ascending track."""
    return sorted((int(track), row) for row, track in enumerate(estimates.track_id) if track)


def child_frame(track: int) -> str:
    """Return the name of the frame that moves with a track."""
    return f"track_{track}"


def to_odometry(estimates: Estimates, frame: str) -> list[Odometry]:
    """Encode each labelled estimate as odometry, by ascending track number.

    The pose is in `frame` and faces along the velocity. The twist is in the frame ``track_NUMBER``,
    whose x axis points along the velocity. Covariances are propagated to first order; terms that
    are not estimated have `UNKNOWN_VARIANCE`.
    """
    up = vertical.of(estimates)
    messages = []
    for track, row in rows_by_track(estimates):
        state, covariance = estimates.state[row], estimates.covariance[row]
        message = Odometry(header=stamps.header(estimates.stamp_ns, frame))
        message.child_frame_id = child_frame(track)
        height, climb = map(float, up.state[row])
        speed = math.hypot(state[VX], state[VY])
        message.pose.pose = pose_of(state, height)
        message.twist.twist = Twist(
            linear=Vector3(x=speed, y=0.0, z=climb),
            angular=Vector3(x=0.0, y=0.0, z=float(state[OMEGA])),
        )
        of_pose = _pose_covariance(state, covariance)
        of_twist = _twist_covariance(state, covariance)
        if up.known[row]:
            of_pose[2, 2], of_twist[2, 2] = np.diag(up.covariance[row])
        message.pose.covariance, message.twist.covariance = of_pose.ravel(), of_twist.ravel()
        messages.append(message)
    return messages


def to_path(track: Sequence[Waypoint], frame: str) -> Path:
    """Encode the path of one track; the header has the stamp of the last, newest waypoint.

    The path is at the track's heights. Before the first known height it is at that height, so that
    it does not rise from the ground; a track without heights is in the map's plane.
    """
    heights = known_heights(track)
    return Path(
        header=stamps.header(track[-1].stamp_ns, frame),
        poses=[
            PoseStamped(
                header=stamps.header(point.stamp_ns, frame),
                pose=pose_of(point.state, 0.0 if math.isnan(height) else height),
            )
            for point, height in zip(track, heights, strict=True)
        ],
    )


def way(track: Sequence[Waypoint]) -> FloatArray:
    """Return a track's positions, shape (N, 3): x, y, and `known_heights`, metres."""
    position = np.array([point.state for point in track])[:, [X, Y]]
    return np.column_stack([position, known_heights(track)])


def known_heights(track: Sequence[Waypoint]) -> list[float]:
    """Return a height per waypoint, metres: its own, else the last known, else the first known.

    All are NaN if none is known.
    """
    height = next((p.height for p in track if not math.isnan(p.height)), math.nan)
    found = []
    for point in track:
        height = height if math.isnan(point.height) else point.height
        found.append(height)
    return found


def pose_of(state: FloatArray, height: float = 0.0) -> Pose:
    """Return the pose of a target at a height, metres, facing along its velocity."""
    half = 0.5 * float(np.arctan2(state[VY], state[VX]))
    return Pose(
        position=Point(x=float(state[X]), y=float(state[Y]), z=height),
        orientation=Quaternion(x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))),
    )


def _pose_covariance(state: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (6, 6) covariance of x, y, z, roll, pitch, yaw."""
    to_pose = np.zeros((6, len(state)))
    to_pose[0, X] = to_pose[1, Y] = 1.0
    square = max(state[VX] ** 2 + state[VY] ** 2, np.finfo(float).tiny)
    to_pose[5, VX], to_pose[5, VY] = -state[VY] / square, state[VX] / square
    yaw_variance = float(to_pose[5] @ covariance @ to_pose[5])
    if not 0.0 < yaw_variance <= LARGEST_YAW_VARIANCE:  # the direction is undetermined
        to_pose[5] = 0.0
    propagated: FloatArray = to_pose @ covariance @ to_pose.T
    if not to_pose[5].any():
        propagated[5, 5] = LARGEST_YAW_VARIANCE
    propagated[[2, 3, 4], [2, 3, 4]] = UNKNOWN_VARIANCE
    return propagated


def _twist_covariance(state: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (6, 6) covariance of vx, vy, vz and the three rates, in the track's frame."""
    yaw = math.atan2(state[VY], state[VX])
    to_twist = np.zeros((6, len(state)))
    to_twist[0, [VX, VY]] = math.cos(yaw), math.sin(yaw)
    to_twist[1, [VX, VY]] = -math.sin(yaw), math.cos(yaw)
    to_twist[5, OMEGA] = 1.0
    propagated: FloatArray = to_twist @ covariance @ to_twist.T
    propagated[[2, 3, 4], [2, 3, 4]] = UNKNOWN_VARIANCE
    return propagated
