"""Joins the pictures of trackers with adjacent regions, and keeps track numbers across the seams.

Where margins overlap, two trackers have a track of the same target. Such tracks are found by their
positions and velocities, stamp by stamp, and get one number. The tracker whose core region contains
the target owns the number. It keeps the number until the target is well inside another core region,
so that ownership does not alternate along a seam.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.tracks.renumbering import match
from phd_jdtc_ros.core.types import Estimates

# Two tracks belong to one target after this many consecutive stamps near each other, and no longer
# after this many apart.
TOGETHER, APART = 2, 3
# Only tracks within this distance of a neighbour's margin, metres, are compared with its tracks.
# Two estimates of one target are always closer, and most regions are much wider.
REACH = 5e3


# Index of a tracker, and its number of a track.
Track = tuple[int, int]

# Largest number of tracks, the latest ones, whose numbers are kept. Without this bound a tracker
# that renumbers its tracks at every stamp would fill the memory.
MOST_TRACKS = 50_000


@dataclass
class Handover:
    """Joins the estimates of several trackers, stamp by stamp."""

    _NO_ROWS = np.zeros(0, dtype=np.int64)

    # One per tracker; their margins should overlap, and their core regions should not.
    regions: Sequence[Region]
    # Depth inside another tracker's core region at which a target is handed over, metres; less than
    # the margins.
    hysteresis: float
    # Joint number of each track.
    _number: dict[Track, int] = field(init=False, default_factory=dict)
    # Tracks with a number, at most one per tracker.
    _tracks: dict[int, dict[int, Track]] = field(init=False, default_factory=dict)
    _owner: dict[int, int] = field(init=False, default_factory=dict)
    # Numbers of consecutive stamps: positive together, negative apart.
    _together: dict[tuple[Track, Track], int] = field(init=False, default_factory=dict)
    _count: int = field(init=False, default=0)
    # Number of times that a target was handed over from one tracker to another.
    handed_over: int = field(init=False, default=0)

    def forget(self) -> None:
        """Forget all tracks; their numbers are not reused."""
        self._number, self._tracks, self._owner, self._together = {}, {}, {}, {}

    def add(self, gathered: Mapping[int, Estimates]) -> Estimates:
        """Return the joint estimates of a stamp, given those of at least one tracker.

        Stamps must increase. The tracks of a missing tracker keep their numbers. Numbers are
        assigned in the order in which targets are first reported.
        """
        found = self._complete(gathered)
        # Depth of each tracker's estimates in each region, [tracker][region].
        depth = [[region.depth(own.position) for region in self.regions] for own in found]
        self._pair(found, depth, gathered.keys())
        rows: dict[int, dict[int, int]] = {}
        for tracker, estimates in enumerate(found):
            for row, number in enumerate(estimates.track_id.tolist()):
                joint = self._number.get((tracker, number))
                if joint is None and depth[tracker][tracker][row] >= 0.0:
                    self._count += 1
                    joint = self._count
                    self._assign((tracker, number), joint)
                if joint is not None:
                    rows.setdefault(joint, {})[tracker] = row
        parts: list[list[tuple[int, int]]] = [[] for _ in found]
        for joint, by_tracker in rows.items():
            owner = self._choose_owner(
                joint, {k: float(depth[k][k][row]) for k, row in by_tracker.items()}
            )
            parts[owner].append((by_tracker[owner], joint))
        self._forget(found, gathered.keys())
        return _joint(found, parts, rows)

    @property
    def numbers(self) -> dict[Track, int]:
        """A copy of the joint number of each current track."""
        return dict(self._number)

    def join_numbered(
        self, gathered: Mapping[int, Estimates], numbers: Mapping[Track, int]
    ) -> Estimates:
        """Return the joint estimates of a stamp whose tracks have numbers already; see `add`.

        Among estimates with one number, the one deepest in its tracker's core region is reported.
        """
        found = self._complete(gathered)
        best: dict[int, tuple[float, int, int]] = {}
        rows: dict[int, dict[int, int]] = {}
        for tracker, estimates in enumerate(found):
            depth = self.regions[tracker].depth(estimates.position).tolist()
            for row, number in enumerate(estimates.track_id.tolist()):
                joint = numbers.get((tracker, number))
                if joint is not None:
                    best[joint] = max(best.get(joint, (-np.inf, 0, 0)), (depth[row], tracker, row))
                    rows.setdefault(joint, {})[tracker] = row
        parts: list[list[tuple[int, int]]] = [[] for _ in found]
        for joint, (_, tracker, row) in best.items():
            parts[tracker].append((row, joint))
        return _joint(found, parts, rows)

    def _complete(self, gathered: Mapping[int, Estimates]) -> list[Estimates]:
        """Return the estimates of every tracker, empty ones for missing trackers."""
        nothing = next(iter(gathered.values())).take(self._NO_ROWS)
        return [gathered.get(tracker, nothing) for tracker in range(len(self.regions))]

    def _pair(
        self,
        found: Sequence[Estimates],
        depth: Sequence[Sequence[FloatArray]],
        present: Collection[int],
    ) -> None:
        """Find the tracks of neighbours that belong to one target, and give them one number."""
        near: set[tuple[Track, Track]] = set()
        for one, other in combinations(range(len(found)), 2):
            mine, theirs = (
                np.flatnonzero(depth[own][next_to] >= -self.regions[next_to].margin - REACH)
                for own, next_to in ((one, other), (other, one))
            )
            pairs = match(found[one].take(mine), found[other].take(theirs), moving=True)
            numbers = found[one].track_id[mine[pairs[0]]], found[other].track_id[theirs[pairs[1]]]
            for number, partner in zip(*(column.tolist() for column in numbers), strict=True):
                near.add(((one, number), (other, partner)))
        for pair in sorted(near):
            self._together[pair] = max(self._together.get(pair, 0), 0) + 1
            if self._together[pair] >= TOGETHER:
                self._join(*pair)
        for pair in sorted(self._together.keys() - near):
            if not all(tracker in present for tracker, _ in pair):
                continue
            self._together[pair] = min(self._together[pair], 0) - 1
            if self._together[pair] <= -APART:
                self._separate(*pair)
                del self._together[pair]

    def _join(self, mine: Track, theirs: Track) -> None:
        """Give two tracks one number: the older reported one, if any is reported.

        A track that is not reported under its number may have moved to another target, which keeps
        its own number.
        """
        known = [track for track in (mine, theirs) if track in self._number]
        owners = [self._owner.get(self._number[track], track[0]) for track in known]
        reported = [track for track, owner in zip(known, owners, strict=True) if track[0] == owner]
        if known:
            joint = min(self._number[track] for track in reported or known)
            self._assign(mine, joint)
            self._assign(theirs, joint)

    def _assign(self, track: Track, joint: int) -> None:
        """Give a track a number; another track of its tracker loses it."""
        if self._number.get(track) == joint:
            return
        self._release(track)
        other = self._tracks.get(joint, {}).get(track[0])
        if other is not None:
            self._release(other)
        self._number[track] = joint
        self._tracks.setdefault(joint, {})[track[0]] = track

    def _release(self, track: Track) -> None:
        """Remove the number of a track, if it has one."""
        joint = self._number.pop(track, None)
        if joint is not None:
            del self._tracks[joint][track[0]]

    def _separate(self, mine: Track, theirs: Track) -> None:
        """Leave the number to its owner when two tracks no longer belong to one target."""
        joint = self._number.get(mine)
        if joint is None or joint != self._number.get(theirs):
            return
        lost = theirs if self._owner.get(joint, mine[0]) == mine[0] else mine
        self._release(lost)

    def _choose_owner(self, joint: int, depth: Mapping[int, float]) -> int:
        """Return the tracker whose estimate is reported, given the depth of each."""
        before = owner = self._owner.get(joint)
        if owner is None or owner not in depth:
            owner = max(depth, key=lambda k: depth[k])
        for tracker, own in depth.items():
            if own > self.hysteresis:
                owner = tracker
        self.handed_over += before is not None and owner != before
        self._owner[joint] = owner
        return owner

    def _forget(self, found: Sequence[Estimates], present: Collection[int]) -> None:
        """Forget tracks that have ended; a tracker does not reuse a number."""
        current = {tracker: set(found[tracker].track_id.tolist()) for tracker in present}

        def stays(track: Track) -> bool:
            tracker, number = track
            return tracker not in current or number in current[tracker]

        for track in [track for track in self._number if not stays(track)]:
            self._release(track)
        self._tracks = {joint: tracks for joint, tracks in self._tracks.items() if tracks}
        alive = self._tracks.keys()
        self._owner = {joint: owner for joint, owner in self._owner.items() if joint in alive}
        self._together = {
            pair: count for pair, count in self._together.items() if all(map(stays, pair))
        }


def _joint(
    found: Sequence[Estimates],
    parts: Sequence[Sequence[tuple[int, int]]],
    rows: Mapping[int, Mapping[int, int]],
) -> Estimates:
    """Return rows of several trackers' estimates in one, with joint numbers.

    `parts` has each tracker's rows with their joint numbers, and `rows` those of all trackers by
    joint number and tracker.
    """
    attributed = any(estimates.attributes is not None for estimates in found)
    own, owner = list[Estimates](), dict[int, int]()
    for tracker, (estimates, numbered) in enumerate(zip(found, parts, strict=True)):
        index = np.array([row for row, _ in numbered], dtype=np.int64)
        number = np.array([joint for _, joint in numbered], dtype=np.int64)
        owner |= dict.fromkeys(number.tolist(), tracker)
        part = replace(estimates.take(index), track_id=number)
        own.append(replace(part, attributes=part.known_attributes if attributed else None))
    # The lag of empty estimates is unknown, because messages carry it with each estimate.
    joined = Estimates.concatenate(own, max(estimates.lag for estimates in found))[0]
    members = np.zeros((len(joined), 1 + len(found)), dtype=np.int64)
    for entry, joint in zip(members, joined.track_id.tolist(), strict=True):
        entry[0] = owner[joint]
        for tracker, row in rows[joint].items():
            entry[1 + tracker] = found[tracker].track_id[row]
    return replace(joined, members=members)


# A track that has ended keeps its number for smoothed estimates for KEPT_S seconds. Numbers are
# forgotten after FORGOTTEN_S seconds.
KEPT_S, FORGOTTEN_S = 60.0, 600.0


@dataclass
class _Spell:
    """An interval in which a track had one number."""

    first_ns: int
    last_ns: int
    number: int


@dataclass
class Numbers:
    """The number that each track had at each filtered stamp."""

    # Longest time after a stamp for which a track of this stamp may still receive its number,
    # nanoseconds.
    wait_ns: int
    _spells: dict[Track, list[_Spell]] = field(init=False, default_factory=dict)

    def add(self, stamp_ns: int, numbers: Mapping[Track, int]) -> None:
        """Add the numbers of a stamp; stamps must increase."""
        for track, number in numbers.items():
            spells = self._spells.setdefault(track, [])
            if spells and spells[-1].number == number:
                spells[-1].last_ns = stamp_ns
            else:
                spells.append(_Spell(stamp_ns, stamp_ns, number))
        oldest_ns = stamp_ns - round(FORGOTTEN_S * 1e9)
        kept = {
            track: [spell for spell in spells if spell.last_ns >= oldest_ns]
            for track, spells in self._spells.items()
        }
        kept = {track: spells for track, spells in kept.items() if spells}
        if len(kept) > MOST_TRACKS:
            latest = sorted(kept, key=lambda track: kept[track][-1].last_ns)[-MOST_TRACKS:]
            kept = {track: kept[track] for track in latest}
        self._spells = kept

    def at(self, stamp_ns: int) -> dict[Track, int]:
        """Return each track's number at a stamp, else its next number, else its last one."""
        found = {}
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        for track, spells in self._spells.items():
            for spell in spells:
                if spell.first_ns <= stamp_ns + self.wait_ns and spell.last_ns >= oldest_ns:
                    found[track] = spell.number
                if spell.last_ns >= stamp_ns:
                    break
        return found
