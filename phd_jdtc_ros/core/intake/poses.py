"""Where a moving platform was: its reported poses, checked, and interpolated to any time.

Poses are compared by their stamps. Between two of them the platform moves straight on and turns
evenly; after the last one it is extrapolated with its last velocity for a bounded time. A pose that
the platform cannot have reached is left out. If the next one agrees with it, the platform has been
relocated: the poses go on from there, and nothing is interpolated across the jump.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from ..arrays import FloatArray, wrap_angle
from ..types import Detections, Pose

# What positions and directions may be off beside the motion itself, metres and radians.
POSITION_SLACK, YAW_SLACK = 5.0, math.radians(10.0)
# No platform turns faster, rad/s.
MOST_YAW_RATE = 1.0
# A platform's velocity is that over at least so long, seconds: over less, the noise of two poses
# would be more of it than the motion.
VELOCITY_S = 0.1
# Poses that are kept at most, whatever their stamps.
MOST_POSES = 100_000


class PoseFault(Enum):
    """Why a pose is not used."""

    DUPLICATE = "duplicate"
    LATE = "late"
    JUMP = "jump"
    ORIENTATION = "orientation"


@dataclass(frozen=True)
class Mount:
    """How a radar sits on its platform.

    Parameters
    ----------
    position : tuple of two floats
        In the platform's frame, metres.
    yaw : float
        Direction of the radar's x axis in that frame, radians counter-clockwise.
    """

    position: tuple[float, float]
    yaw: float

    def on(self, platform: Pose) -> Pose:
        """Return the radar's pose, given that of its platform."""
        (x, y), (ahead, left) = platform.position, self.position
        cos, sin = math.cos(platform.yaw), math.sin(platform.yaw)
        position = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        return Pose(position, math.remainder(platform.yaw + self.yaw, 2.0 * math.pi))


@dataclass
class PoseTrack:
    """The poses of one platform by stamp.

    Parameters
    ----------
    turned : bool
        Whether its yaw turns what is mounted on it. If not, it is taken as 0.
    max_age_s : float
        Farthest that a time may be from the nearest pose, seconds.
    max_speed : float
        Speed above which a change between two poses is a jump, metres per second.
    reset_threshold_s : float
        A stamp that is further behind the newest than this begins a new run.
    """

    turned: bool = True
    max_age_s: float = 1.0
    max_speed: float = 100.0
    reset_threshold_s: float = math.inf
    _stamps: list[int] = field(init=False, default_factory=list)
    _poses: list[Pose] = field(init=False, default_factory=list)
    # Between poses of two segments there was a jump.
    _segments: list[int] = field(init=False, default_factory=list)
    _doubted: tuple[int, Pose] | None = field(init=False, default=None)

    def add(self, stamp_ns: int, pose: Pose) -> PoseFault | None:
        """Take in a pose; return why it is not used, or None if it is."""
        if not self.turned:
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
                return self._jumped(stamp_ns, pose)
        self._append(stamp_ns, pose, self._segments[-1] if self._segments else 0)
        return None

    def segment(self, stamp_ns: int) -> tuple[tuple[int, Pose], tuple[int, Pose]] | None:
        """Return two poses with stamps that tell the velocity at a stamp, None if there are none.

        They are the first at the stamp or after it, or the last, and one at least `VELOCITY_S`
        before it, without a jump between them. Later poses do not count, so that it does not matter
        how many of them have come.
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
        """Return the pose at a stamp, None if it is not known; and whether it is extrapolated."""
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
        # A velocity over some time: that of two close poses would be mostly their noise.
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
            moved <= POSITION_SLACK + self.max_speed * since
            and turned <= YAW_SLACK + MOST_YAW_RATE * since
        )

    def _jumped(self, stamp_ns: int, pose: Pose) -> PoseFault | None:
        """Leave out a pose that cannot be reached, unless it goes on from another such one."""
        doubted, self._doubted = self._doubted, (stamp_ns, pose)
        if doubted is None or stamp_ns <= doubted[0]:
            return PoseFault.JUMP
        if not self._reachable(doubted, stamp_ns, pose):
            return PoseFault.JUMP
        segment = self._segments[-1] + 1
        self._append(*doubted, segment)
        self._append(stamp_ns, pose, segment)
        return None

    def _append(self, stamp_ns: int, pose: Pose, segment: int) -> None:
        self._doubted = None
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        self._segments.append(segment)
        kept_s = self.reset_threshold_s + 2.0 * self.max_age_s
        oldest = max(len(self._stamps) - MOST_POSES, 0)
        if math.isfinite(kept_s):
            oldest = max(oldest, bisect_left(self._stamps, stamp_ns - round(kept_s * 1e9)))
        # The two newest stay: what comes next is compared with them.
        oldest = min(oldest, len(self._stamps) - 2)
        if oldest > 0:
            del self._stamps[:oldest], self._poses[:oldest], self._segments[:oldest]

    def _clear(self) -> None:
        self._stamps, self._poses, self._segments, self._doubted = [], [], [], None


@dataclass
class Platform:
    """What carries a radar.

    Parameters
    ----------
    track : PoseTrack
    mount : Mount
    """

    track: PoseTrack
    mount: Mount

    def posed(self, stamp_ns: int, found: Detections) -> tuple[Detections | None, bool]:
        """Return detections with the radar's pose at their stamp, and if it is extrapolated.

        Detections with times of their own were measured from where the radar was then; they become
        what it would have measured from where it was at the stamp. None if a pose is not known.
        Range rates need its velocity too, and are left out where that is not known: after the first
        pose, and after a jump.
        """
        at_stamp, extrapolated = self.track.at(stamp_ns)
        if at_stamp is None:
            return None, False
        pose = self.mount.on(at_stamp)
        if found.range_rate is not None:
            velocity = self.velocity(stamp_ns)
            if velocity is None:
                found = replace(found, range_rate=None, range_rate_std=None)
            else:
                pose = replace(pose, velocity=velocity)
        if found.time_s is None or not len(found):
            return replace(found, pose=pose), extrapolated
        own = []
        for time_s in found.time_s.tolist():
            then, beyond = self.track.at(stamp_ns + round(time_s * 1e9))
            if then is None:
                return None, False
            mounted = self.mount.on(then)
            own.append((*mounted.position, mounted.yaw))
            extrapolated |= beyond
        x, y, yaw = np.transpose(own)
        distance, azimuth = found.measurement.T
        east = x + distance * np.cos(azimuth + yaw) - pose.position[0]
        north = y + distance * np.sin(azimuth + yaw) - pose.position[1]
        seen = np.stack([np.hypot(east, north), np.arctan2(north, east) - pose.yaw], axis=1)
        seen[:, 1] = wrap_angle(seen[:, 1])
        found = replace(found, measurement=seen, pose=pose)
        return self._at_the_stamp(stamp_ns, found, azimuth + yaw), extrapolated

    def velocity(self, stamp_ns: int) -> tuple[float, float] | None:
        """Return the radar's velocity at a stamp in the world frame, m/s; None if it is unknown.

        It is that over the last poses, with what the platform's turning makes of it.
        """
        known = self.track.segment(stamp_ns)
        if known is None:
            return None
        (begin_ns, begin), (end_ns, end) = known
        since = (end_ns - begin_ns) * 1e-9
        (x, y), (later_x, later_y) = self.mount.on(begin).position, self.mount.on(end).position
        return (later_x - x) / since, (later_y - y) / since

    def _at_the_stamp(self, stamp_ns: int, found: Detections, bearing: FloatArray) -> Detections:
        """Return detections with range rates as from the radar's velocity at the stamp.

        `bearing` are the directions in which they were measured, world frame, radians.
        """
        if found.range_rate is None or found.time_s is None or found.pose is None:
            return found
        then = [self.velocity(stamp_ns + round(time_s * 1e9)) for time_s in found.time_s.tolist()]
        own = np.array([found.pose.velocity if one is None else one for one in then])
        change = own - np.asarray(found.pose.velocity)
        toward = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        return replace(found, range_rate=found.range_rate + (change * toward).sum(axis=1))

    def reaches(self, stamp_ns: int, found: Detections) -> bool:
        """Return whether the poses reach all times of some detections."""
        latest = 0.0 if found.time_s is None else float(found.time_s.max(initial=0.0))
        return self.track.reaches(stamp_ns + round(latest * 1e9))
