"""Finds the pose of frames in the world frame by chains of transforms, as of ``/tf``.

A transform is the pose of a child frame in its parent. The frames are a tree: a frame in which the
world and a radar meet gives the radar's pose in the world. Static transforms hold at all times;
others are interpolated between their stamps, positions linearly and rotations at a constant rate.

The poses of a moving frame are given out once, at the stamps of the transforms of its chain, as
soon as all of these reach them. Only transforms of the chains have a history; of other frames the
last one is kept, because a chain may lead over them later.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from ..types import Pose
from .poses import PoseFault

# Longest history of a transform, seconds, and the largest number of its stamps.
HISTORY_S, MOST_STAMPS = 30.0, 10_000
# Largest number of frames, and of the transforms of a chain.
MOST_FRAMES, LONGEST_CHAIN = 10_000, 100

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def attitude(rotation: Quaternion) -> tuple[float, tuple[float, float]]:
    """Return the yaw and the tilt of a pose, see `Pose`."""
    i, j, k, w = rotation
    ahead, left = w**2 + i**2 - j**2 - k**2, 2.0 * (i * j + w * k)
    up, across = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i)
    above = w**2 + k**2 - i**2 - j**2
    tilt = math.atan2(up, math.hypot(ahead, left)), math.atan2(across, above)
    return math.atan2(left, ahead), tilt


def of_angles(yaw: float, tilt: tuple[float, float]) -> Quaternion:
    """Return the rotation of a pose with a yaw and a tilt, the inverse of `attitude`."""
    none = 0.0, 0.0, 0.0
    half_yaw, half_pitch, half_roll = (0.5 * angle for angle in (yaw, *tilt))
    turns = (
        Placement(none, (0.0, 0.0, math.sin(half_yaw), math.cos(half_yaw))),
        Placement(none, (0.0, -math.sin(half_pitch), 0.0, math.cos(half_pitch))),
        Placement(none, (math.sin(half_roll), 0.0, 0.0, math.cos(half_roll))),
    )
    return turns[0].of(turns[1]).of(turns[2]).rotation


class Placement(NamedTuple):
    """The pose of a frame in another one."""

    translation: Vector  # Metres
    rotation: Quaternion  # Components x, y, z and w, of norm 1

    def of(self, inner: Placement) -> Placement:
        """Return the pose in the other frame of what is placed in this frame."""
        (x, y, z), (i, j, k, w) = self.translation, self.rotation
        dx, dy, dz = self._turned(inner.translation)
        a, b, c, d = inner.rotation
        product = (
            w * a + i * d + j * c - k * b,
            w * b - i * c + j * d + k * a,
            w * c + i * b - j * a + k * d,
            w * d - i * a - j * b - k * c,
        )
        return Placement((x + dx, y + dy, z + dz), product)

    def inverse(self) -> Placement:
        """Return the pose of the other frame in this one."""
        i, j, k, w = self.rotation
        back = Placement((0.0, 0.0, 0.0), (-i, -j, -k, w))
        x, y, z = back._turned(self.translation)
        return Placement((-x, -y, -z), back.rotation)

    def between(self, later: Placement, share: float) -> Placement:
        """Return the pose after a share of the way to a later one."""
        pairs = zip(self.translation, later.translation, strict=True)
        x, y, z = (own + share * (other - own) for own, other in pairs)
        cosine = sum(own * o for own, o in zip(self.rotation, later.rotation, strict=True))
        # A quaternion and its negative are one rotation; the shorter way is taken.
        angle = math.acos(min(abs(cosine), 1.0))
        # Below 1e-6 rad the ratio of sines is that of the angles, without their division by zero.
        sine = math.sin(angle) if angle > 1e-6 else 0.0
        before = math.sin((1.0 - share) * angle) / sine if sine else 1.0 - share
        after = math.copysign(math.sin(share * angle) / sine if sine else share, cosine)
        pairs = zip(self.rotation, later.rotation, strict=True)
        i, j, k, w = (before * own + after * other for own, other in pairs)
        return Placement((x, y, z), (i, j, k, w))

    def pose(self) -> Pose:
        """Return the place, the yaw and the tilt of the frame."""
        yaw, tilt = attitude(self.rotation)
        return Pose(self.translation[:2], yaw, height=self.translation[2], tilt=tilt)

    def _turned(self, vector: Vector) -> Vector:
        """Return a vector of this frame along the axes of the other one."""
        (i, j, k, w), (x, y, z) = self.rotation, vector
        a, b, c = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
        return (
            x + w * a + j * c - k * b,
            y + w * b + k * a - i * c,
            z + w * c + i * b - j * a,
        )


IDENTITY = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class Transform(NamedTuple):
    """The pose of a frame in its parent at a stamp."""

    parent: str
    child: str
    stamp_ns: int
    placement: Placement


@dataclass
class _Link:
    """The transforms of a frame to one parent, by ascending stamps."""

    parent: str
    static: bool
    stamps_ns: list[int] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)

    def add(self, stamp_ns: int, placement: Placement, reset_ns: float, history_ns: float) -> None:
        """Add a transform; one that is older than the newest by `reset_ns` begins a new run."""
        if self.static or (self.stamps_ns and stamp_ns < self.stamps_ns[-1] - reset_ns):
            self.stamps_ns, self.placements = [], []
        at = bisect_left(self.stamps_ns, stamp_ns)
        same = self.stamps_ns[at : at + 1] == [stamp_ns]
        self.stamps_ns[at : at + same] = [stamp_ns]
        self.placements[at : at + same] = [placement]
        oldest = bisect_left(self.stamps_ns, self.stamps_ns[-1] - history_ns)
        del self.stamps_ns[: max(oldest, len(self.stamps_ns) - MOST_STAMPS)]
        del self.placements[: len(self.placements) - len(self.stamps_ns)]

    def at(self, stamp_ns: int) -> Placement:
        """Return the transform at a stamp, which must be within its history unless it is static."""
        after = 0 if self.static else bisect_left(self.stamps_ns, stamp_ns)
        if self.static or self.stamps_ns[after] == stamp_ns:
            return self.placements[after]
        first_ns, last_ns = self.stamps_ns[after - 1 : after + 1]
        share = (stamp_ns - first_ns) / (last_ns - first_ns)
        return self.placements[after - 1].between(self.placements[after], share)


@dataclass
class _Chain:
    """The links from a frame up to an ancestor, and those from the world up to it."""

    frames: tuple[list[str], list[str]] | None = None  # None if there is no common ancestor
    moving: list[_Link] = field(default_factory=list)  # Those that are not static
    fixed: Pose | None = None  # The pose that was given out, if no link moves
    until_ns: int | None = None  # Poses were given out up to this stamp


class TransformBuffer:
    """The transforms from some frames to the world frame.

    A stamp that is further behind the newest of its transform than `reset_threshold_s` begins a new
    run. Frames are named without a leading slash.
    """

    def __init__(
        self, world: str, frames: Iterable[str], reset_threshold_s: float = math.inf
    ) -> None:
        self._world = world
        self._reset_ns = reset_threshold_s * 1e9
        self._links: dict[str, _Link] = {}
        self._chains = {frame: _Chain() for frame in frames}
        self._find_chains()

    def add(self, transform: Transform, static: bool) -> PoseFault | None:
        """Add a transform, unless it closes a circle; return what is wrong with it.

        A circle through the world frame is opened above that, however late it is closed.
        The latest counts if a frame of a chain had another parent before, or had it on the topic
        of the transforms of the other kind.
        """
        parent, child, stamp_ns, placement = transform
        above, circle = self.path(parent), None
        if child in above:
            circle = PoseFault.CIRCLE
            if self._world not in above[: above.index(child)]:
                return circle
            del self._links[self._world]
        link, moved = self._links.get(child), False
        if link is None or (link.parent, link.static) != (parent, static):
            moved = link is not None and self.needs(child)
            if link is None and len(self._links) >= MOST_FRAMES:
                del self._links[next(name for name in self._links if not self.needs(name))]
            link = self._links[child] = _Link(parent, static)
            self._find_chains()
        history_ns = HISTORY_S * 1e9 if self.needs(child) else 0.0
        link.add(stamp_ns, placement, self._reset_ns, history_ns)
        return circle or (PoseFault.PARENT if moved else None)

    def needs(self, frame: str) -> bool:
        """Return whether a frame's transform is in a chain, as far as the chains are known."""
        return frame in self._chained

    def poses(self, frame: str) -> list[tuple[int | None, Pose]]:
        """Return the poses of a frame in the world that are new since the last call, by stamp.

        The stamp is None for a pose at all times, if all transforms of the chain are static.
        """
        chain = self._chains[frame]
        if chain.frames is None:
            return []
        before, chain.fixed = chain.fixed, None
        if not chain.moving:
            chain.fixed = self._pose(chain, 0)
            return [] if chain.fixed == before else [(None, chain.fixed)]
        until_ns = min(link.stamps_ns[-1] for link in chain.moving)
        since_ns = max(link.stamps_ns[0] for link in chain.moving)
        if chain.until_ns is not None and until_ns >= chain.until_ns - self._reset_ns:
            since_ns = max(since_ns, chain.until_ns + 1)
            until_ns = max(until_ns, chain.until_ns)
        chain.until_ns = until_ns
        stamps_ns: set[int] = set()
        for link in chain.moving:
            first = bisect_left(link.stamps_ns, since_ns)
            stamps_ns.update(link.stamps_ns[first : bisect_right(link.stamps_ns, until_ns)])
        return [(stamp_ns, self._pose(chain, stamp_ns)) for stamp_ns in sorted(stamps_ns)]

    def is_fixed(self, frame: str) -> bool:
        """Return whether all transforms of a frame's chain are static."""
        return self._chains[frame].frames is not None and not self._chains[frame].moving

    def broken(self, frame: str) -> str:
        """Return where the chain from a frame to the world is broken; empty if it is not."""
        if self._chains[frame].frames is not None:
            return ""
        path = self.path(frame)
        end = path[-1]
        why = f"has more than {LONGEST_CHAIN} frames" if len(path) == LONGEST_CHAIN else "ends"
        return (
            f"no transform from {end!r} to {self._world!r}: the chain from {frame!r} {why} at "
            f"{end!r}"
        )

    def late(self, frame: str) -> str:
        """Return which transform of a frame's unbroken chain ends first; empty if none moves.

        If another one begins later, as with another clock, both are named.
        """
        names = (name for part in self._chains[frame].frames or () for name in part)
        ends = {name: self._links[name] for name in names if not self._links[name].static}
        if not ends:
            return ""
        first = min(ends, key=lambda name: ends[name].stamps_ns[-1])
        last = max(ends, key=lambda name: ends[name].stamps_ns[0])
        end_ns, begin_ns = ends[first].stamps_ns[-1], ends[last].stamps_ns[0]
        text = (
            f"the transform from {first!r} to {ends[first].parent!r} ends at {end_ns / 1e9:.3f} s"
        )
        if begin_ns <= end_ns:
            return text
        return (
            f"{text}, before that from {last!r} to {ends[last].parent!r} begins at "
            f"{begin_ns / 1e9:.3f} s"
        )

    def path(self, frame: str) -> list[str]:
        """Return a frame and its ancestors, none of them twice."""
        path = [frame]
        while len(path) < LONGEST_CHAIN:
            link = self._links.get(path[-1])
            if link is None or link.parent in path:
                break
            path.append(link.parent)
        return path

    def _pose(self, chain: _Chain, stamp_ns: int) -> Pose:
        up, down = (self._placement(names, stamp_ns) for names in chain.frames or ([], []))
        return down.inverse().of(up).pose()

    def _placement(self, frames: list[str], stamp_ns: int) -> Placement:
        """Return the pose of the first frame in the parent of the last."""
        placement = IDENTITY
        for frame in frames:
            placement = self._links[frame].at(stamp_ns).of(placement)
        return placement

    def _find_chains(self) -> None:
        down = self.path(self._world)
        self._chained = {*down}
        for frame, chain in self._chains.items():
            up, chain.frames, chain.moving = self.path(frame), None, []
            self._chained.update(up)
            common = next((name for name in up if name in down), None)
            if common is not None:
                chain.frames = up[: up.index(common)], down[: down.index(common)]
                links = [self._links[name] for part in chain.frames for name in part]
                chain.moving = [link for link in links if not link.static]
