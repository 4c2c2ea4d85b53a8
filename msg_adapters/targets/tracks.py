"""Tracks as odometry and as paths, for consumers that follow individual targets."""

from __future__ import annotations

import math
import uuid
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from nav_msgs.msg import Odometry, Path

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.state_space import OMEGA, VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from ..encoding import cdr, interfaces, names, stamps
from . import vertical

# Variance of quantities that a planar track does not estimate: height, roll, pitch and their rates.
UNKNOWN_VARIANCE = 1e6


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
        message = Odometry(header=stamps.header(estimates.stamp_ns, frame))
        message.child_frame_id = child_frame(track)
        message.pose, message.twist = pose_and_twist(estimates, row, up)
        messages.append(message)
    return messages


def pose_and_twist(
    estimates: Estimates, row: int, up: vertical.Vertical
) -> tuple[PoseWithCovariance, TwistWithCovariance]:
    """Return an estimate's pose, and its twist in the frame that the pose gives."""
    state, covariance = estimates.state[row], estimates.covariance[row]
    height, climb = map(float, up.state[row])
    of_pose, of_twist = pose_covariance(state, covariance), twist_covariance(state, covariance)
    if up.known[row]:
        of_pose[2, 2], of_twist[2, 2] = np.diag(up.covariance[row])
    twist = Twist(
        linear=Vector3(x=math.hypot(state[VX], state[VY]), y=0.0, z=climb),
        angular=Vector3(x=0.0, y=0.0, z=float(state[OMEGA])),
    )
    return (
        PoseWithCovariance(pose=pose_of(state, height), covariance=of_pose.ravel()),
        TwistWithCovariance(twist=twist, covariance=of_twist.ravel()),
    )


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


def pose_covariance(state: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (6, 6) covariance of x, y, z, roll, pitch, yaw."""
    # Variance of an angle that is uniform over the circle.
    largest_yaw_variance = math.pi**2 / 3.0
    to_pose = np.zeros((6, len(state)))
    to_pose[0, X] = to_pose[1, Y] = 1.0
    square = max(state[VX] ** 2 + state[VY] ** 2, np.finfo(float).tiny)
    to_pose[5, VX], to_pose[5, VY] = -state[VY] / square, state[VX] / square
    yaw_variance = float(to_pose[5] @ covariance @ to_pose[5])
    if not 0.0 < yaw_variance <= largest_yaw_variance:  # The direction is undetermined
        to_pose[5] = 0.0
    propagated: FloatArray = to_pose @ covariance @ to_pose.T
    if not to_pose[5].any():
        propagated[5, 5] = largest_yaw_variance
    propagated[[2, 3, 4], [2, 3, 4]] = UNKNOWN_VARIANCE
    return propagated


def twist_covariance(state: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the (6, 6) covariance of vx, vy, vz and the three rates, in the track's frame."""
    yaw = math.atan2(state[VY], state[VX])
    to_twist = np.zeros((6, len(state)))
    to_twist[0, [VX, VY]] = math.cos(yaw), math.sin(yaw)
    to_twist[1, [VX, VY]] = -math.sin(yaw), math.cos(yaw)
    to_twist[5, OMEGA] = 1.0
    propagated: FloatArray = to_twist @ covariance @ to_twist.T
    propagated[[2, 3, 4], [2, 3, 4]] = UNKNOWN_VARIANCE
    return propagated


def poses_to_cdr(estimates: Estimates, class_id: int, frame: str) -> bytes:
    """Return a serialised ``geometry_msgs/PoseArray``; each pose faces along the velocity.

    Poses are at the estimates' heights, or in the map's plane if these are unknown.
    """
    mine = estimates.class_id == class_id
    rows = estimates.state[mine]
    half = 0.5 * np.arctan2(rows[:, VY], rows[:, VX])
    # Position x y z, orientation x y z w.
    pose = np.zeros((len(rows), 7))
    pose[:, 0], pose[:, 1] = rows[:, X], rows[:, Y]
    pose[:, 2] = vertical.states(estimates)[mine, 0]
    pose[:, 5], pose[:, 6] = np.sin(half), np.cos(half)
    writer = cdr.Writer()
    writer.header(estimates.stamp_ns, frame)
    writer.rows(pose)
    return writer.message()


def to_detections_3d(
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
        detection = message_class(names.DETECTION_3D)(header=header)
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


def identifier(estimates: Estimates, row: int, run: uuid.UUID) -> Any:
    """Return the UUID of an estimate, 16 bytes: that of its track in a run, else one of its own."""
    label = int(estimates.track_id[row])
    name = str(label) if label else f"{estimates.stamp_ns} {row}"
    return np.frombuffer(uuid.uuid5(run, name).bytes, dtype=np.uint8)


def to_radar_tracks(
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
    for row in range(len(estimates)):
        state, covariance = estimates.state[row].tolist(), estimates.covariance[row]
        height, climb = map(float, up.state[row])
        track = message_class("radar_msgs/msg/RadarTrack")()
        track.uuid.uuid = identifier(estimates, row, run)
        track.position = Point(x=state[X], y=state[Y], z=height)
        track.velocity = Vector3(x=state[VX], y=state[VY], z=climb)
        # First number that the message's definition reserves for a user's own classifications.
        track.classification = 32000 + int(estimates.class_id[row])
        track.position_covariance = _upper_triangle(covariance, (X, Y), up.covariance[row, 0, 0])
        track.velocity_covariance = _upper_triangle(covariance, (VX, VY), up.covariance[row, 1, 1])
        message.tracks.append(track)
    return message


def _upper_triangle(covariance: FloatArray, plane: tuple[int, int], upward: float) -> Any:
    """Return the terms xx, xy, xz, yy, yz, zz of a covariance, as float32."""
    x, y = plane
    terms = [covariance[x, x], covariance[x, y], 0.0, covariance[y, y], 0.0, upward]
    return np.array(terms, dtype=np.float32)


# A trail is continued if its track is estimated again within this number of scans.
UNSEEN_SCANS = 10


class Trails:
    """The latest positions of each track that was estimated in the last `UNSEEN_SCANS` scans.

    At most `length` positions are kept per track.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._latest: Estimates | None = None
        self._trails: dict[int, deque[Waypoint]] = {}
        self._unseen: dict[int, int] = {}

    def of(self, found: Estimates) -> dict[int, deque[Waypoint]]:
        """Return the trails of a scan's tracks up to the scan, by ascending number.

        Estimates are added only once, because several outputs may request the trails of one scan.
        """
        if found is not self._latest:
            self._latest = found
            self._add(found)
        return {track: self._trails[track] for track, _ in rows_by_track(found)}

    def _add(self, found: Estimates) -> None:
        self._unseen = {track: scans + 1 for track, scans in self._unseen.items()}
        heights = found.known_attributes.height[:, 0].tolist()
        for track, row in rows_by_track(found):
            trail = self._trails.setdefault(track, deque(maxlen=self._length))
            trail.append(Waypoint(found.stamp_ns, found.state[row], heights[row]))
            self._unseen[track] = 0
        for track in [track for track, scans in self._unseen.items() if scans > UNSEEN_SCANS]:
            del self._trails[track], self._unseen[track]

    def clear(self) -> None:
        """Remove all trails."""
        self._latest, self._trails, self._unseen = None, {}, {}
