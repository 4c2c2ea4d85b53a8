"""Checks the reported poses of a moving platform, and interpolates them to any time.

Poses are ordered by their stamps. Between two poses the platform moves in a straight line and turns
at a constant rate; after the last one its pose is extrapolated with its last velocity for a bounded
time. A pose that the platform cannot have reached is ignored. If the next pose agrees with it, the
platform has been relocated, and no pose is interpolated across the jump.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import Detections, Pose

# Tolerance of a plausible change of position in addition to the motion, metres.
POSITION_TOLERANCE = 5.0
# The same tolerance of the yaw, radians.
YAW_TOLERANCE = math.radians(10.0)
# Largest yaw rate of a platform, rad/s.
MAX_YAW_RATE = 1.0
# Shortest interval over which a velocity is computed, seconds; over a shorter one the noise of two
# poses would exceed the motion.
VELOCITY_S = 0.1
# Largest number of poses that are kept.
MAX_POSES = 100_000


class PoseFault(Enum):
    """Why a pose was rejected."""

    DUPLICATE = "duplicate"
    LATE = "late"
    JUMP = "jump"
    ORIENTATION = "orientation"


@dataclass(frozen=True)
class Mount:
    """Mounting of a radar on its platform."""

    position: tuple[float, float]  # Position in the platform's frame, metres
    yaw: float  # Direction of the radar's x axis in that frame, radians counter-clockwise

    def on(self, platform: Pose) -> Pose:
        """Return the radar's pose, given that of its platform."""
        (x, y), (ahead, left) = platform.position, self.position
        cos, sin = math.cos(platform.yaw), math.sin(platform.yaw)
        position = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        return Pose(position, math.remainder(platform.yaw + self.yaw, 2.0 * math.pi))


@dataclass
class PoseTrack:
    """The poses of one platform by stamp."""

    # Whether azimuths turn with the platform. If not, they are stabilised, and the platform's yaw
    # is taken as 0.
    yaw_applies: bool = True
    max_age_s: float = 1.0  # Longest interval between a time and the nearest pose, seconds
    # Speed above which a change between two poses is a jump, metres per second.
    max_speed: float = 100.0
    # A stamp that is further behind the newest than this begins a new run.
    reset_threshold_s: float = math.inf
    _stamps: list[int] = field(init=False, default_factory=list)
    _poses: list[Pose] = field(init=False, default_factory=list)
    # The platform has jumped between poses of different segments.
    _segments: list[int] = field(init=False, default_factory=list)
    _suspect: tuple[int, Pose] | None = field(init=False, default=None)

    def add(self, stamp_ns: int, pose: Pose) -> PoseFault | None:
        """Add a pose; return why it was rejected, or None."""
        if not self.yaw_applies:
            pose = replace(pose, yaw=0.0)
        elif not math.isfinite(pose.yaw):
            return PoseFault.ORIENTATION
        if self._stamps:
            newest = self._stamps[-1]
            if stamp_ns < newest - self.reset_threshold_s * 1e9:
                self._clear()
            elif stamp_ns <= newest:
                return PoseFault.DUPLICATE if stamp_ns == newest else PoseFault.LATE
            elif not self._reachable((newest, self._poses[-1]), stamp_ns, pose):
                return self._reject_jump(stamp_ns, pose)
        self._append(stamp_ns, pose, self._segments[-1] if self._segments else 0)
        return None

    def segment(self, stamp_ns: int) -> tuple[tuple[int, Pose], tuple[int, Pose]] | None:
        """Return the two poses, with stamps, for the velocity at a stamp; None if there are none.

        The second is the first pose at or after the stamp, or else the last
        one. The first is at least `VELOCITY_S` earlier, without a jump in between. Later poses have
        no influence, so the result does not depend on how many of them have arrived.
        """
        last = min(bisect_left(self._stamps, stamp_ns), len(self._stamps) - 1)
        if last > 0 and self._segments[last - 1] != self._segments[last]:
            last -= 1
        first = bisect_right(self._stamps, self._stamps[last] - round(VELOCITY_S * 1e9)) - 1
        first = max(first, 0)
        while self._segments[first] != self._segments[last]:
            first += 1
        if first >= last:
            return None
        return (self._stamps[first], self._poses[first]), (self._stamps[last], self._poses[last])

    def reaches(self, stamp_ns: int) -> bool:
        """Return whether there is a pose at a stamp or after it."""
        return bool(self._stamps) and self._stamps[-1] >= stamp_ns

    def at(self, stamp_ns: int) -> tuple[Pose | None, bool]:
        """Return the pose at a stamp, None if unknown; and whether it is extrapolated."""
        last = bisect_right(self._stamps, stamp_ns) - 1
        if last < 0:
            return None, False
        since = (stamp_ns - self._stamps[last]) * 1e-9
        if not since:
            return self._poses[last], False
        following = last + 1
        if following < len(self._stamps) and self._segments[last] == self._segments[following]:
            until = (self._stamps[following] - stamp_ns) * 1e-9
            near = min(since, until) <= self.max_age_s
            return (self._between(last, following, stamp_ns) if near else None), False
        if since > self.max_age_s:
            return None, False
        # The velocity of two close poses would be mostly their noise.
        window_ns = self._stamps[last] - round(self.max_age_s * 1e9)
        first = min(bisect_left(self._stamps, window_ns), max(last - 1, 0))
        while self._segments[first] != self._segments[last]:
            first += 1
        return (self._between(first, last, stamp_ns) if first < last else None), True

    def _between(self, first: int, second: int, stamp_ns: int) -> Pose:
        """Return the pose at a stamp on the straight line through two poses."""
        begin, end = self._poses[first], self._poses[second]
        begin_ns = self._stamps[first]
        share = (stamp_ns - begin_ns) / (self._stamps[second] - begin_ns)
        turn = math.remainder(end.yaw - begin.yaw, 2.0 * math.pi)
        return Pose(
            (
                begin.position[0] + share * (end.position[0] - begin.position[0]),
                begin.position[1] + share * (end.position[1] - begin.position[1]),
            ),
            math.remainder(begin.yaw + share * turn, 2.0 * math.pi),
        )

    def _reachable(self, known: tuple[int, Pose], stamp_ns: int, pose: Pose) -> bool:
        since = (stamp_ns - known[0]) * 1e-9
        moved = math.dist(known[1].position, pose.position)
        turned = abs(math.remainder(pose.yaw - known[1].yaw, 2.0 * math.pi))
        return (
            moved <= POSITION_TOLERANCE + self.max_speed * since
            and turned <= YAW_TOLERANCE + MAX_YAW_RATE * since
        )

    def _reject_jump(self, stamp_ns: int, pose: Pose) -> PoseFault | None:
        """Ignore a pose that cannot be reached, unless it continues from another such pose."""
        suspect, self._suspect = self._suspect, (stamp_ns, pose)
        if suspect is None or stamp_ns <= suspect[0]:
            return PoseFault.JUMP
        if not self._reachable(suspect, stamp_ns, pose):
            return PoseFault.JUMP
        segment = self._segments[-1] + 1
        self._append(*suspect, segment)
        self._append(stamp_ns, pose, segment)
        return None

    def _append(self, stamp_ns: int, pose: Pose, segment: int) -> None:
        self._suspect = None
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        self._segments.append(segment)
        kept_s = self.reset_threshold_s + 2.0 * self.max_age_s
        oldest = max(len(self._stamps) - MAX_POSES, 0)
        if math.isfinite(kept_s):
            oldest = max(oldest, bisect_left(self._stamps, stamp_ns - round(kept_s * 1e9)))
        # The two newest stay, because the next pose is compared with them.
        oldest = min(oldest, len(self._stamps) - 2)
        if oldest > 0:
            del self._stamps[:oldest], self._poses[:oldest], self._segments[:oldest]

    def _clear(self) -> None:
        self._stamps, self._poses, self._segments, self._suspect = [], [], [], None


@dataclass
class Platform:
    """A moving platform with its radar."""

    track: PoseTrack
    mount: Mount

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
            velocity = self.velocity(stamp_ns)
            if velocity is None:
                detections = replace(detections, range_rate=None, range_rate_std=None)
            else:
                pose = replace(pose, velocity=velocity)
        if detections.time_s is None or not len(detections):
            return replace(detections, pose=pose), extrapolated
        own = []
        for time_s in detections.time_s.tolist():
            then, beyond = self.track.at(stamp_ns + round(time_s * 1e9))
            if then is None:
                return None, False
            mounted = self.mount.on(then)
            own.append((*mounted.position, mounted.yaw))
            extrapolated |= beyond
        x, y, yaw = np.transpose(own)
        distance, azimuth = detections.measurement.T
        east = x + distance * np.cos(azimuth + yaw) - pose.position[0]
        north = y + distance * np.sin(azimuth + yaw) - pose.position[1]
        seen = np.stack([np.hypot(east, north), np.arctan2(north, east) - pose.yaw], axis=1)
        seen[:, 1] = wrap_angle(seen[:, 1])
        detections = replace(detections, measurement=seen, pose=pose)
        return self._at_stamp(stamp_ns, detections, azimuth + yaw), extrapolated

    def velocity(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the radar's velocity at a stamp in the world frame, m/s; None if unknown.

        It follows from the last poses, and includes the motion by the platform's rotation.
        """
        known = self.track.segment(stamp_ns)
        if known is None:
            return None
        (begin_ns, begin), (end_ns, end) = known
        since = (end_ns - begin_ns) * 1e-9
        (x, y), (later_x, later_y) = self.mount.on(begin).position, self.mount.on(end).position
        return (later_x - x) / since, (later_y - y) / since

    def _at_stamp(self, stamp_ns: int, detections: Detections, bearing: FloatArray) -> Detections:
        """Return detections with range rates relative to the radar's velocity at the stamp.

        `bearing` has their directions in the world frame, radians.
        """
        if detections.range_rate is None or detections.time_s is None or detections.pose is None:
            return detections
        then = [
            self.velocity(stamp_ns + round(time_s * 1e9)) for time_s in detections.time_s.tolist()
        ]
        own = np.array([detections.pose.velocity if one is None else one for one in then])
        change = own - np.asarray(detections.pose.velocity)
        toward = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        return replace(detections, range_rate=detections.range_rate + (change * toward).sum(axis=1))

    def reaches(self, stamp_ns: int, detections: Detections) -> bool:
        """Return whether the poses reach all times of some detections."""
        latest = 0.0 if detections.time_s is None else float(detections.time_s.max(initial=0.0))
        return self.track.reaches(stamp_ns + round(latest * 1e9))
