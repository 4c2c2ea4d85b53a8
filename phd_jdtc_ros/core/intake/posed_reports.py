"""Holds back the reports of moving radars until their poses are known, and adds these.

A report waits for a pose at or after its stamp, so that its own pose is interpolated, whichever of
the two arrives first. The stamps of later reports show when the pose is overdue: it is then
extrapolated, or the report is dropped. Reports behind a waiting one wait too, which keeps the order
of arrival.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..sensors.gaussians import noise_covariance
from ..sensors.spatial_radar import seen_at, sides
from ..types import LEVEL, Detections, Pose
from .poses import Mount, PoseFault, PoseTrack


def _from_plane(detections: Detections, pose: Pose, poses: Sequence[Pose]) -> Detections:
    """Return ranges, azimuths and range rates as measured from a pose.

    `poses` has the radar's pose at the time of each detection, with its velocity if they have range
    rates.
    """
    x, y, yaw = np.transpose([(*each.position, each.yaw) for each in poses])
    distance, azimuth = detections.measurement.T
    bearing = azimuth + yaw
    toward = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    east = x + distance * toward[:, 0] - pose.position[0]
    north = y + distance * toward[:, 1] - pose.position[1]
    angle = wrap_angle(np.arctan2(north, east) - pose.yaw)
    rate = detections.range_rate
    if rate is not None:  # Relative to the radar's velocity at the stamp
        change = np.array([each.velocity for each in poses]) - pose.velocity
        rate = rate + (change * toward).sum(axis=1)
    measurement = np.stack([np.hypot(east, north), angle], axis=1)
    return replace(detections, measurement=measurement, range_rate=rate)


def _places_from_plane(detections: Detections, pose: Pose, poses: Sequence[Pose]) -> Detections:
    """Return places and velocities, see `_from_plane`."""
    x, y, yaw = np.transpose([(*each.position, each.yaw) for each in poses])
    origin = np.stack([x, y], axis=1) - pose.position
    place = _turned(_turned(detections.measurement, yaw) + origin, -pose.yaw)
    turned = detections.velocity
    if turned is not None:
        turned = _turned(turned, yaw - pose.yaw)
    return replace(detections, measurement=place, velocity=turned)


def _from_space(detections: Detections, pose: Pose, poses: Sequence[Pose]) -> Detections:
    """Return ranges, azimuths, elevations and range rates, see `_from_plane`."""
    turn, offset = _motions(pose, poses)
    line = np.einsum("mij,mj->mi", turn, sides(detections.measurement))
    rate = detections.range_rate
    if rate is not None:
        away = line / np.maximum(detections.measurement[:, :1], 1e-9)
        velocity = np.array([(*each.velocity, each.climb) for each in poses])
        change = (velocity - (*pose.velocity, pose.climb)) @ pose.rotation
        rate = rate + (change * away).sum(axis=1)
    return replace(detections, measurement=seen_at(line + offset), range_rate=rate)


def _levelled(
    detections: Detections, pose: Pose, poses: Sequence[Pose], mounted: float
) -> tuple[Detections, Pose]:
    """Return places and velocities in space in the level frame of a pose, and that pose.

    `poses` has a pose for each detection, or one for all, and `mounted` is the height that z has of
    the sensor's mounting. A place without a z counts as at the sensor's height. Deviations are
    turned where all three are known; the errors of z then count as independent of those along the
    ground.
    """
    level = replace(pose, tilt=LEVEL)
    turn, offset = _motions(level, poses)
    place, z = detections.measurement, detections.z
    up = np.zeros(len(place)) if z is None else z - mounted
    place = np.column_stack([place, np.nan_to_num(up, nan=0.0)])
    place = np.einsum("mij,mj->mi", np.broadcast_to(turn, (len(place), 3, 3)), place) + offset
    changed = {"measurement": place[:, :2]}
    if z is not None:
        changed["z"] = np.where(np.isfinite(z), place[:, 2] + level.height, np.nan)
    if detections.velocity is not None:
        axes = detections.velocity.shape[1]
        velocity = np.pad(detections.velocity, ((0, 0), (0, 3 - axes)))
        changed["velocity"] = np.einsum("mij,mj->mi", turn, velocity)[:, :axes]
    std, upward = detections.noise_std, detections.z_std
    if std is not None and upward is not None:
        own = np.column_stack([std, upward])
        covariance = noise_covariance(own, detections.noise_correlation)
        covariance = turn @ covariance @ turn.swapaxes(1, 2)
        own = np.sqrt(np.einsum("mii->mi", covariance))
        known = np.isfinite(own).all(axis=1)
        changed["noise_std"] = np.where(known[:, None], own[:, :2], std)
        changed["z_std"] = np.where(known, own[:, 2], upward)
        if detections.noise_correlation is not None:
            correlation = covariance[:, 0, 1] / np.where(known, own[:, 0] * own[:, 1], 1.0)
            changed["noise_correlation"] = np.where(
                known, correlation, detections.noise_correlation
            )
    return replace(detections, **changed), level


def _motions(pose: Pose, poses: Sequence[Pose]) -> tuple[FloatArray, FloatArray]:
    """Return rotations, (K, 3, 3), and offsets, metres, (K, 3), from poses to a pose's frame."""
    back = pose.rotation.T
    turn = back @ np.stack([each.rotation for each in poses])
    place = np.array([(*each.position, each.height) for each in poses])
    offset: FloatArray = (place - (*pose.position, pose.height)) @ back.T
    return turn, offset


def _turned(vector: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Return vectors, (M, 2), turned counter-clockwise by angles, radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vector.T
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


@dataclass
class Platform:
    """A moving platform with its sensor."""

    track: PoseTrack
    mount: Mount
    positions: bool = False  # Whether the sensor measures positions, and not range and azimuth

    def with_pose(self, stamp_ns: int, detections: Detections) -> tuple[Detections | None, bool]:
        """Return detections with the radar's pose at their stamp, and whether it is extrapolated.

        Detections with times of their own were measured from the radar's pose at that time; they
        are transformed to its pose at the stamp. The result is None if a pose is unknown. Range
        rates also need the velocity, and are left out if it is unknown: after the first pose, and
        after a jump.
        """
        at_stamp, extrapolated = self.track.at(stamp_ns)
        if at_stamp is None:
            return None, False
        pose = self.mount.on(at_stamp)
        if detections.range_rate is not None:
            motion = self._motion(stamp_ns)
            if motion is None:
                detections = replace(detections, range_rate=None, range_rate_std=None)
            else:
                pose = replace(pose, velocity=motion[:2], climb=motion[2])
        poses, times_s = [pose], detections.time_s
        timed = times_s is not None and len(times_s) > 0
        if times_s is not None and timed:
            poses = []
            for time_s in times_s.tolist():
                time_ns = stamp_ns + round(time_s * 1e9)
                at_time, is_extrapolated = self.track.at(time_ns)
                if at_time is None:
                    return None, False
                mounted = self.mount.on(at_time)
                if detections.range_rate is not None:
                    east, north, up = self._motion(time_ns) or (*pose.velocity, pose.climb)
                    mounted = replace(mounted, velocity=(east, north), climb=up)
                poses.append(mounted)
                extrapolated |= is_extrapolated
        if self.positions and self.track.in_space:
            detections, pose = _levelled(detections, pose, poses, self.mount.height)
        elif timed:
            moved = _from_space if self.track.in_space else _from_plane
            moved = _places_from_plane if self.positions else moved
            detections = moved(detections, pose, poses)
        return replace(detections, pose=pose), extrapolated

    def own_pose(self, stamp_ns: int) -> Pose | None:
        """Return the radar's place and velocity with the platform's heading; None if unknown.

        The heading is NaN if azimuths do not turn with the platform, and the velocity if unknown.
        """
        pose = self.track.at(stamp_ns)[0]
        if pose is None:
            return None
        yaw = pose.yaw if self.track.yaw_applies else math.nan
        velocity = self.velocity(stamp_ns) or (math.nan, math.nan)
        return Pose(self.mount.on(pose).position, yaw, velocity)

    def velocity(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the radar's velocity at a stamp in the world frame, m/s; None if unknown.

        It is the measured one if there is one, or else follows from the last poses, and includes
        the motion by the platform's rotation.
        """
        motion = self._motion(stamp_ns)
        return None if motion is None else motion[:2]

    def _motion(self, stamp_ns: int) -> tuple[float, float, float] | None:
        """Return `velocity` with the climb rate, which is 0 in the plane."""
        pose, twist = self.track.at(stamp_ns)[0], self.track.twist(stamp_ns)
        if pose is not None and twist is not None:
            if self.track.in_space:
                turning = np.cross(twist[3:], self.mount.arm)
                east, north, up = (pose.rotation @ (turning + twist[:3])).tolist()
                return east, north, up
            cos, sin, (x, y) = math.cos(pose.yaw), math.sin(pose.yaw), self.mount.position
            ahead, left = twist[0] - twist[5] * y, twist[1] + twist[5] * x
            return cos * ahead - sin * left, sin * ahead + cos * left, 0.0
        poses = self.track.poses_for_velocity(stamp_ns)
        if poses is None:
            return None
        first, second = (self.mount.on(stamped.pose) for stamped in poses)
        since = (poses[1].stamp_ns - poses[0].stamp_ns) * 1e-9
        (x, y), (later_x, later_y) = first.position, second.position
        climb = (second.height - first.height) / since
        return (later_x - x) / since, (later_y - y) / since, climb

    def reaches(self, stamp_ns: int, detections: Detections) -> bool:
        """Return whether the poses reach all times of some detections."""
        latest = 0.0 if detections.time_s is None else float(detections.time_s.max(initial=0.0))
        return self.track.reaches(stamp_ns + round(latest * 1e9))


class _Waiting(NamedTuple):
    """A slice of a report that waits for a pose."""

    radar: int
    stamp_ns: int
    detections: Detections
    latest_ns: int  # Latest stamp of the report's slices


class RadarPose(NamedTuple):
    """A pose of the platform that carries a radar, or of the radar itself if that is known."""

    radar: int  # Index in the configured order
    stamp_ns: int | None  # None for a pose that holds at all times
    pose: Pose


class PosedReport(NamedTuple):
    """A report, with the pose of its radar at the report's stamp."""

    radar: int  # Index in the configured order
    stamp_ns: int
    size: int  # Number of detections
    # With the radar's pose if it moves; None if the pose is unknown.
    detections: Detections | None
    extrapolated: bool = False  # Whether the pose was extrapolated


class PosedReports:
    """Queue of the reports that wait for poses, in their order of arrival.

    Platforms are in the configured order of the radars; None for a fixed radar.
    """

    def __init__(self, platforms: Sequence[Platform | None]) -> None:
        self._platforms = tuple(platforms)
        self.moving = any(platform is not None for platform in platforms)  # Whether any radar moves
        self._queue: deque[_Waiting] = deque()

    @property
    def waiting(self) -> bool:
        """Whether a report is held back."""
        return bool(self._queue)

    @property
    def awaited(self) -> int | None:
        """The radar of the first report that is held back; None without one."""
        return self._queue[0].radar if self._queue else None

    def add(self, radar: int, slices: Sequence[tuple[int, Detections]]) -> None:
        """Add the slices of a report, each with its stamp."""
        latest_ns = max(stamp_ns for stamp_ns, _ in slices)
        self._queue += [_Waiting(radar, *each, latest_ns) for each in slices]

    def add_pose(self, radar: int, stamp_ns: int | None, pose: Pose) -> PoseFault | None:
        """Add a pose of a radar's platform, see `PoseTrack.add`."""
        platform = self._platforms[radar]
        if platform is None:
            raise ValueError(f"radar: {radar} given, must be one that moves")
        return platform.track.add(stamp_ns, pose)

    def release(self, everything: bool = False) -> Iterator[PosedReport]:
        """Yield the reports that need not wait any longer, or all of them."""
        while self._queue and (everything or self._is_ready()):
            radar, stamp_ns, detections, _ = self._queue.popleft()
            platform = self._platforms[radar]
            posed = (detections,) if platform is None else platform.with_pose(stamp_ns, detections)
            yield PosedReport(radar, stamp_ns, len(detections), *posed)

    def forget(self) -> None:
        """Discard all reports; the poses stay."""
        self._queue.clear()

    def _is_ready(self) -> bool:
        first = self._queue[0]
        platform = self._platforms[first.radar]
        if platform is None or platform.reaches(first.stamp_ns, first.detections):
            return True
        overdue_ns = first.latest_ns + platform.track.max_age_s * 1e9
        # A report from before this stamp begins a new run: the old one gets no more poses.
        back_ns = first.latest_ns - platform.track.reset_threshold_s * 1e9
        return any(each.latest_ns > overdue_ns or each.latest_ns < back_ns for each in self._queue)
