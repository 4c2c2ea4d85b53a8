# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One picture of several trackers that part an area, with numbers that stay at the seams.

Where margins overlap, two trackers have a track of one target. Such tracks are found by their
positions and velocities, stamp by stamp, and get one number. One of the trackers owns it: that in
whose core region the target is. It owns it until the target is well inside another's, so that it
does not change over to and fro along a seam.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from .arrays import FloatArray
from .region import Region
from .renumbering import matched
from .reporting import chosen, joined
from .types import Estimates

# Tracks are of one target once they have been near each other for so many stamps in a row, and no
# longer once they have been apart for so many.
TOGETHER, APART = 2, 3

# A tracker, by its index, and its number of a track.
Track = tuple[int, int]


@dataclass
class Handover:
    """Joins the estimates of several trackers, stamp by stamp.

    Parameters
    ----------
    regions : sequence of Region
        One per tracker; their core regions should not overlap, and their margins should.
    hysteresis : float
        How far a target must be inside another tracker's core region to change over, metres; less
        than the margins.
    """

    regions: Sequence[Region]
    hysteresis: float
    # The number in the joint picture, of each track and of what it is one with.
    _number: dict[Track, int] = field(init=False, default_factory=dict)
    _owner: dict[int, int] = field(init=False, default_factory=dict)
    # Stamps in a row: positive together, negative apart.
    _together: dict[tuple[Track, Track], int] = field(init=False, default_factory=dict)
    _count: int = field(init=False, default=0)

    def add(self, found: Sequence[Estimates]) -> Estimates:
        """Return the joint estimates of a stamp.

        Parameters
        ----------
        found : sequence of Estimates
            One per tracker, all of one stamp; stamps must increase.

        Returns
        -------
        Estimates
            With numbers that are given here, in the order in which targets are first reported.
        """
        self._pair(found)
        rows: dict[int, dict[int, int]] = {}
        for tracker, estimates in enumerate(found):
            for row, number in enumerate(estimates.track_id.tolist()):
                joint = self._number.get((tracker, number))
                if joint is None and self._depth(tracker, estimates.position[row]) >= 0.0:
                    joint = self._begin((tracker, number))
                if joint is not None:
                    rows.setdefault(joint, {})[tracker] = row
        parts: list[list[tuple[int, int]]] = [[] for _ in found]
        for joint, by_tracker in rows.items():
            owner = self._owned(joint, by_tracker, found)
            parts[owner].append((by_tracker[owner], joint))
        self._forget(found)
        return _joint(found, parts)

    @property
    def numbers(self) -> dict[Track, int]:
        """The joint number of each track that is there; a copy."""
        return dict(self._number)

    def numbered(self, found: Sequence[Estimates], numbers: Mapping[Track, int]) -> Estimates:
        """Return the joint estimates of a stamp whose tracks have numbers already.

        Of several of one number that is reported which is deepest in its tracker's core region.
        """
        best: dict[int, tuple[float, int, int]] = {}
        for tracker, estimates in enumerate(found):
            depth = self.regions[tracker].depth(estimates.position).tolist()
            for row, number in enumerate(estimates.track_id.tolist()):
                joint = numbers.get((tracker, number))
                if joint is not None:
                    best[joint] = max(best.get(joint, (-np.inf, 0, 0)), (depth[row], tracker, row))
        parts: list[list[tuple[int, int]]] = [[] for _ in found]
        for joint, (_, tracker, row) in best.items():
            parts[tracker].append((row, joint))
        return _joint(found, parts)

    def _depth(self, tracker: int, position: FloatArray) -> float:
        """Return how far inside a tracker's core region a position is, metres."""
        return float(self.regions[tracker].depth(position[None])[0])

    def _begin(self, track: Track) -> int:
        self._count += 1
        self._number[track] = self._count
        return self._count

    def _pair(self, found: Sequence[Estimates]) -> None:
        """Find which tracks of neighbours are of one target, and give them one number."""
        near: set[tuple[Track, Track]] = set()
        for one, other in combinations(range(len(found)), 2):
            for row, column in zip(*matched(found[one], found[other], moving=True), strict=True):
                mine = one, int(found[one].track_id[row])
                theirs = other, int(found[other].track_id[column])
                near.add((mine, theirs))
        # In one order, because pairs of three trackers' tracks share them.
        for pair in sorted(near):
            self._together[pair] = max(self._together.get(pair, 0), 0) + 1
            if self._together[pair] >= TOGETHER:
                self._join(*pair)
        for pair in sorted(self._together.keys() - near):
            self._together[pair] = min(self._together[pair], 0) - 1
            if self._together[pair] <= -APART:
                self._part(*pair)
                del self._together[pair]

    def _join(self, mine: Track, theirs: Track) -> None:
        """Give two tracks one number: the older one of those that are reported, if any is.

        A track that only follows its number may have gone over to another target, which keeps its
        own.
        """
        known = [track for track in (mine, theirs) if track in self._number]
        reported = [track for track in known if self._owns(track)]
        if known:
            joint = min(self._number[track] for track in reported or known)
            self._give(mine, joint)
            self._give(theirs, joint)

    def _owns(self, track: Track) -> bool:
        """Return whether a track is the one that is reported under its number."""
        return self._owner.get(self._number[track], track[0]) == track[0]

    def _give(self, track: Track, joint: int) -> None:
        """Give a track a number; another track of its tracker loses it."""
        if self._number.get(track) == joint:
            return
        others = [own for own, number in self._number.items() if number == joint]
        for other in others:
            if other[0] == track[0]:
                del self._number[other]
        self._number[track] = joint

    def _part(self, mine: Track, theirs: Track) -> None:
        """Leave the number to its owner once two tracks are no longer of one target."""
        joint = self._number.get(mine)
        if joint is None or joint != self._number.get(theirs):
            return
        lost = theirs if self._owner.get(joint, mine[0]) == mine[0] else mine
        del self._number[lost]

    def _owned(self, joint: int, by_tracker: Mapping[int, int], found: Sequence[Estimates]) -> int:
        """Return which tracker's estimate is reported."""
        depth = {
            tracker: self._depth(tracker, found[tracker].position[row])
            for tracker, row in by_tracker.items()
        }
        owner = self._owner.get(joint)
        if owner is None or owner not in by_tracker:
            owner = max(depth, key=lambda k: depth[k])
        for tracker, inside in depth.items():
            if inside > self.hysteresis:
                owner = tracker
        self._owner[joint] = owner
        return owner

    def _forget(self, found: Sequence[Estimates]) -> None:
        """Forget tracks that are no longer there; a tracker does not use a number twice."""
        there = {
            (tracker, number)
            for tracker, estimates in enumerate(found)
            for number in estimates.track_id.tolist()
        }
        self._number = {track: joint for track, joint in self._number.items() if track in there}
        alive = set(self._number.values())
        self._owner = {joint: owner for joint, owner in self._owner.items() if joint in alive}
        self._together = {
            pair: count for pair, count in self._together.items() if there.issuperset(pair)
        }


def _joint(found: Sequence[Estimates], parts: Sequence[Sequence[tuple[int, int]]]) -> Estimates:
    """Return rows of several trackers' estimates as one, with joint numbers."""
    own = []
    for estimates, rows in zip(found, parts, strict=True):
        index = np.array([row for row, _ in rows], dtype=np.int64)
        number = np.array([joint for _, joint in rows], dtype=np.int64)
        own.append(replace(chosen(estimates, index), track_id=number))
    return joined(own, found[0].lag)[0]
