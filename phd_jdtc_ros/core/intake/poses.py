"""Checks the reported poses of a moving platform, and interpolates them to any time.

Poses are ordered by their stamps. Between two poses the platform moves in a straight line and
revolutions at a constant rate; after the last one its pose is extrapolated with its last velocity
for a bounded time. A pose that the platform cannot have reached is ignored. If the next pose agrees
with it, the platform has been relocated, and no pose is interpolated across the jump.

The velocity is the measured one, if the poses have it. Otherwise it is the difference of two poses
over an interval that suits their noise: a longer one averages the noise, and delays accelerations.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..types import LEVEL, Pose, angles_of, rotation_of

# Shortest interval over which a velocity is computed, seconds.
VELOCITY_S = 0.1
# Largest angle, radians, between the z axis of a platform in the plane and the vertical. Of a frame
# that lies on its side, such as a camera's, or is upside down, azimuths are not in the plane.
STEEPEST = math.radians(60.0)


class PoseFault(Enum):
    """Why a pose was rejected."""

    DUPLICATE = "duplicate"
    LATE = "late"
    JUMP = "jump"
    ORIENTATION = "orientation"
    PARENT = "parent"  # The frame had another parent, or was on the other topic; the pose is used
    CIRCLE = "circle"  # The parent is a descendant of the frame; the transform is not used


@dataclass(frozen=True)
class Mount:
    """Mounting of a radar on its platform."""

    position: tuple[float, float]  # In the platform's frame, metres
    yaw: float  # Direction of the radar's x axis in that frame, radians counter-clockwise
    height: float = 0.0  # Above the platform's origin, metres; 0 in the plane
    tilt: tuple[float, float] = LEVEL  # See `Pose.tilt`

    @property
    def arm(self) -> FloatArray:
        """Place of the radar in the platform's frame, metres, (3,)."""
        return np.array([*self.position, self.height])

    def on(self, platform: Pose) -> Pose:
        """Return the radar's pose, given that of its platform."""
        (x, y), (ahead, left) = platform.position, self.position
        if platform.tilt != LEVEL or self.tilt != LEVEL:
            turn = platform.rotation
            east, north, up = (turn @ self.arm).tolist()
            yaw, tilt = angles_of(turn @ rotation_of(self.yaw, self.tilt))
            height = platform.height + up
            return Pose((x + east, y + north), yaw, height=height, tilt=tilt)
        cos, sin = math.cos(platform.yaw), math.sin(platform.yaw)
        position = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        yaw = math.remainder(platform.yaw + self.yaw, 2.0 * math.pi)
        return Pose(position, yaw, height=platform.height + self.height)


class _StampedPose(NamedTuple):
    """A pose of a platform."""

    stamp_ns: int
    pose: Pose
    segment: int  # The platform has jumped between poses of different segments
    # Variance of the noise of the positions up to this one along an axis, square metres, and the
    # number of poses from which it is estimated.
    variance: float = 0.0
    averaged: int = 0

    @property
    def velocity_s(self) -> float:
        """Interval, seconds, over which a difference has the least error.

        It is the sum of the variances of the noise, 2 s^2 / T^2, and of half the change of the
        velocity, (a T / 2)^2.
        """
        # Usual acceleration of a platform, m/s^2, which limits this interval.
        return max(VELOCITY_S, math.sqrt(math.sqrt(8.0 * self.variance) / 2.0))


@dataclass
class PoseTrack:
    """The poses of one platform by stamp."""

    # True if azimuths turn with the platform. If not, they are stabilised, and the platform's yaw
    # counts as 0.
    yaw_applies: bool = True
    max_age_s: float = 1.0  # Longest interval between a time and the nearest pose, seconds
    # Speed above which a change between two poses is a jump, metres per second.
    max_speed: float = 100.0
    # A stamp that is further behind the newest than this begins a new run.
    reset_threshold_s: float = math.inf
    in_space: bool = False  # Whether heights, roll and pitch count
    _poses: list[_StampedPose] = field(init=False, default_factory=list)
    _suspect: _StampedPose | None = field(init=False, default=None)
    _fixed: Pose | None = field(init=False, default=None)  # Its pose while it does not move

    def add(self, stamp_ns: int | None, pose: Pose) -> PoseFault | None:
        """Add a pose, with the stamp None one that holds at all times until the next is added.

        Return why it was rejected, or None.
        """
        upright = True
        if not self.in_space:
            upright = math.cos(pose.tilt[0]) * math.cos(pose.tilt[1]) > math.cos(STEEPEST)
            pose = replace(pose, height=0.0, tilt=LEVEL)
        if not self.yaw_applies:
            pose = replace(pose, yaw=0.0, tilt=LEVEL, twist=_in_the_world(pose))
        elif not (upright and math.isfinite(pose.yaw)):
            return PoseFault.ORIENTATION
        self._fixed = pose if stamp_ns is None else None
        if stamp_ns is None:
            return None
        newest, added = self._poses[-1] if self._poses else None, _StampedPose(stamp_ns, pose, 0)
        if newest is not None:
            ahead_ns = stamp_ns - newest.stamp_ns
            if -self.reset_threshold_s * 1e9 <= ahead_ns <= 0:
                return PoseFault.LATE if ahead_ns else PoseFault.DUPLICATE
            if ahead_ns < 0 or not self._is_reachable(newest, added):
                return self._reject_jump(added, newest.segment + 1)
            added = added._replace(segment=newest.segment)
        self._append(added)
        return None

    def poses_for_velocity(self, stamp_ns: int) -> tuple[_StampedPose, _StampedPose] | None:
        """Return the two poses from which the velocity at a stamp follows; None without two.

        The second is the first pose at or after the stamp, or else the last one. The first is at
        least `VELOCITY_S` earlier, or longer if the poses are noisy, without a jump in between.
        Later poses have no influence, so the result does not depend on how many of them have
        arrived.
        """
        last = min(self._index(stamp_ns), len(self._poses) - 1)
        if last > 0 and self._poses[last - 1].segment != self._poses[last].segment:
            last -= 1
        until_ns = self._poses[last].stamp_ns - round(self._poses[last].velocity_s * 1e9)
        return self._pair(self._index(until_ns + 1) - 1, last)

    def twist(self, stamp_ns: int) -> tuple[float, ...] | None:
        """Return the measured velocity at a stamp, as a pose's; None if it is unknown.

        It is interpolated between the poses before and after the stamp, and is that of the nearest
        one without both of them.
        """
        if self._fixed is not None:
            return (0.0,) * 6
        following = self._index(stamp_ns)
        nearest = self._poses[max(following - 1, 0) : following + 1]
        first, last = nearest[0], nearest[-1]
        if first.pose.twist is None or last.pose.twist is None or first.segment != last.segment:
            return None
        share = (stamp_ns - first.stamp_ns) / max(last.stamp_ns - first.stamp_ns, 1)
        return tuple(
            own + min(max(share, 0.0), 1.0) * (later - own)
            for own, later in zip(first.pose.twist, last.pose.twist, strict=True)
        )

    def reaches(self, stamp_ns: int) -> bool:
        """Return whether there is a pose at a stamp or after it."""
        return self._fixed is not None or self._index(stamp_ns) < len(self._poses)

    def at(self, stamp_ns: int) -> tuple[Pose | None, bool]:
        """Return the pose at a stamp, None if unknown; and whether it is extrapolated."""
        if self._fixed is not None:
            return self._fixed, False
        last = self._index(stamp_ns + 1) - 1
        if last < 0:
            return None, False
        previous = self._poses[last]
        since = (stamp_ns - previous.stamp_ns) * 1e-9
        if not since:
            return previous.pose, False
        for following in self._poses[last + 1 : last + 2]:
            if following.segment == previous.segment:
                until = (following.stamp_ns - stamp_ns) * 1e-9
                is_near = min(since, until) <= self.max_age_s
                return (_between(previous, following, stamp_ns) if is_near else None), False
        if since > self.max_age_s:
            return None, False
        # The velocity of two close poses would be mostly their noise.
        window = self._index(previous.stamp_ns - round(self.max_age_s * 1e9))
        pair = self._pair(min(window, last - 1), last)
        return (None if pair is None else _between(*pair, stamp_ns)), True

    def _index(self, stamp_ns: int) -> int:
        """Return the index of the first pose at or after a stamp."""
        return bisect_left(self._poses, stamp_ns, key=lambda stamped: stamped.stamp_ns)

    def _pair(self, first: int, last: int) -> tuple[_StampedPose, _StampedPose] | None:
        """Return two poses without a jump in between: the first one not before an index."""
        first = max(first, 0)
        while self._poses[first].segment != self._poses[last].segment:
            first += 1
        return (self._poses[first], self._poses[last]) if first < last else None

    def _is_reachable(self, earlier: _StampedPose, later: _StampedPose) -> bool:
        since = (later.stamp_ns - earlier.stamp_ns) * 1e-9
        if since > self.reset_threshold_s:
            return False
        distance = math.dist(earlier.pose.position, later.pose.position)
        turn = abs(math.remainder(later.pose.yaw - earlier.pose.yaw, 2.0 * math.pi))
        return (
            # Tolerance of a plausible change of position in addition to the motion, metres.
            distance <= 5.0 + self.max_speed * since
            # The same of the yaw, radians, with the largest yaw rate of a platform, rad/s.
            and turn <= math.radians(10.0) + 1.0 * since
        )

    def _reject_jump(self, added: _StampedPose, segment: int) -> PoseFault | None:
        """Ignore a pose that cannot be reached, unless it continues from another such pose.

        Poses with earlier stamps than those before begin a new run.
        """
        suspect, self._suspect = self._suspect, added
        if (
            suspect is None
            or added.stamp_ns <= suspect.stamp_ns
            or not self._is_reachable(suspect, added)
        ):
            return PoseFault.JUMP
        if suspect.stamp_ns < self._poses[-1].stamp_ns:
            self._poses.clear()
        self._append(suspect._replace(segment=segment))
        self._append(added._replace(segment=segment))
        return None

    def _append(self, added: _StampedPose) -> None:
        self._suspect = None
        self._poses.append(_with_noise(added, self._poses[-2:]))
        kept_s = self.reset_threshold_s + 2.0 * self.max_age_s
        # Largest number of poses that are kept.
        oldest = max(len(self._poses) - 100_000, 0)
        if math.isfinite(kept_s):
            oldest = max(oldest, self._index(added.stamp_ns - round(kept_s * 1e9)))
        # The two newest stay, because the next pose is compared with them.
        del self._poses[: max(min(oldest, len(self._poses) - 2), 0)]


def _in_the_world(pose: Pose) -> tuple[float, ...] | None:
    """Return the twist of a platform whose yaw counts as 0, so that ahead is the world's x axis."""
    if pose.twist is None or not math.isfinite(pose.yaw):
        return None
    ahead, left, up, *_ = pose.twist
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return cos * ahead - sin * left, sin * ahead + cos * left, up, 0.0, 0.0, 0.0


def _with_noise(added: _StampedPose, before: list[_StampedPose]) -> _StampedPose:
    """Return a pose with the variance of the noise, given the two poses before it.

    It follows from how far the middle one of three poses is from the line through the others.
    """
    if not before:
        return added
    if len(before) < 2 or before[0].segment != added.segment:
        return added._replace(variance=before[-1].variance, averaged=before[-1].averaged)
    first, middle = before
    between = _between(first, added, middle.stamp_ns).position
    share = (middle.stamp_ns - first.stamp_ns) / (added.stamp_ns - first.stamp_ns)
    squares = math.dist(between, middle.pose.position) ** 2
    variance = 0.5 * squares / (1.0 + share**2 + (1.0 - share) ** 2)
    # Number of poses over which the variance of their noise is averaged.
    count = min(middle.averaged + 1, 20)
    mean = middle.variance + (variance - middle.variance) / count
    return added._replace(variance=mean, averaged=count)


def _between(first: _StampedPose, second: _StampedPose, stamp_ns: int) -> Pose:
    """Return the pose at a stamp on the straight line through two poses."""
    (x, y), (later_x, later_y) = first.pose.position, second.pose.position
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    turn = math.remainder(second.pose.yaw - first.pose.yaw, 2.0 * math.pi)
    (height, *tilt), later = ((each.pose.height, *each.pose.tilt) for each in (first, second))
    between = [
        own + share * math.remainder(other - own, 2.0 * math.pi)
        for own, other in zip(tilt, later[1:], strict=True)
    ]
    return Pose(
        (x + share * (later_x - x), y + share * (later_y - y)),
        math.remainder(first.pose.yaw + share * turn, 2.0 * math.pi),
        height=height + share * (later[0] - height),
        tilt=(between[0], between[1]),
    )
