"""Gathers the estimates of several trackers by stamp, and decides when a stamp is complete.

Stamps define time; the time of arrival does not matter, so that delays of topics do not change the
result. A stamp is closed when every tracker has reported it or a later one. It waits at most for
the longest delay: when the newest stamp is later by more, the stamp is overdue, and the trackers
that have not reached it are silent. The others do not wait for a silent tracker until it reports a
recent stamp.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from phd_jdtc_ros.core.types import Estimates

# Estimates of one stamp, by the index of their tracker.
Gathered = Mapping[int, Estimates]
# If the number of waiting stamps is bounded, so is their mean number of targets.
TARGETS_OF_A_STAMP = 100


def too_many(waiting: Collection[Gathered], most: int | None) -> bool:
    """Return whether too many stamps, or too many targets with them, wait; one stamp always may."""
    if most is None or len(waiting) < 2:
        return False
    targets = sum(len(own) for gathered in waiting for own in gathered.values())
    return len(waiting) > most or targets > most * TARGETS_OF_A_STAMP


class Refusal(Enum):
    """Reason why estimates are refused."""

    DUPLICATE = "duplicate"
    LATE = "late"


@dataclass
class Gathering:
    """Gathers the filtered or the smoothed estimates of one run."""

    trackers: int  # Number of trackers
    # Longest time by which a waiting stamp may be behind the newest one, seconds; infinite for
    # recordings, which are complete.
    longest_delay_s: float
    # Upper bound of the waiting stamps (see `too_many`), above which the oldest is closed; None for
    # no bound.
    most_waiting: int | None = None
    # Number of stamps that were closed because too many waited.
    overflow: int = field(init=False, default=0)
    _pending: dict[int, dict[int, Estimates]] = field(init=False, default_factory=dict)
    _latest: dict[int, int] = field(init=False, default_factory=dict)
    _interval: dict[int, int] = field(init=False, default_factory=dict)
    _first_ns: int | None = field(init=False, default=None)
    _closed_ns: int | None = field(init=False, default=None)
    # Known stamps that are not overdue, ascending; and the newest overdue one.
    _recent: list[int] = field(init=False, default_factory=list)
    _overdue_ns: int | None = field(init=False, default=None)
    _silent: set[int] = field(init=False, default_factory=set)

    @property
    def silent(self) -> frozenset[int]:
        """Indices of the silent trackers."""
        return frozenset(self._silent)

    @property
    def newest_ns(self) -> int:
        """The newest stamp of any tracker; 0 before the first."""
        return max(self._latest.values(), default=0)

    def latest_ns(self, tracker: int) -> int | None:
        """Return a tracker's latest stamp, even a refused one; None before its first."""
        return self._latest.get(tracker)

    def expected_ns(self, at_most_ns: float = math.inf) -> dict[int, float]:
        """Return the latest stamp whose estimates may still arrive from each tracker, nanoseconds.

        It is the tracker's latest stamp plus its last interval plus the longest delay. Trackers
        without estimates are omitted.
        """
        longest_ns = self.longest_delay_s * 1e9
        return {
            tracker: min(latest + self._interval.get(tracker, 0) + longest_ns, at_most_ns)
            for tracker, latest in self._latest.items()
        }

    def behind_s(self, tracker: int) -> float:
        """Return the age of a tracker's latest stamp relative to the newest of all, seconds.

        For a tracker without estimates it is the age of the first stamp.
        """
        if self._first_ns is None:
            return 0.0
        return (self.newest_ns - self._latest.get(tracker, self._first_ns)) * 1e-9

    def jumps_back(self, tracker: int, stamp_ns: int) -> bool:
        """Return whether a stamp is older than the tracker's latest one."""
        return stamp_ns < self._latest.get(tracker, stamp_ns)

    def add(self, tracker: int, found: Estimates) -> list[Gathered] | Refusal:
        """Add the estimates of a tracker; return the stamps that are now closed, oldest first.

        They are without the trackers that have no estimates of them. Estimates are refused if their
        stamp is closed already, or the tracker has reported it before.
        """
        stamp = found.stamp_ns
        if stamp == self._latest.get(tracker) or tracker in self._pending.get(stamp, {}):
            return Refusal.DUPLICATE
        self._record(tracker, stamp)
        if self._closed_ns is not None and stamp <= self._closed_ns:
            return Refusal.LATE
        self._pending.setdefault(stamp, {})[tracker] = found
        # The newest tracker is never silent, so at least one is awaited.
        awaited = [self._latest.get(k) for k in range(self.trackers) if k not in self._silent]
        until = None if None in awaited else min(stamp for stamp in awaited if stamp is not None)
        closed = [] if until is None else self._close(until)
        while too_many(self._pending.values(), self.most_waiting):
            self.overflow += 1
            closed += self._close(min(self._pending))
        return closed

    def close_all(self) -> list[Gathered]:
        """Close all stamps, oldest first."""
        return self._close(max(self._pending, default=0))

    def _record(self, tracker: int, stamp: int) -> None:
        """Record a tracker's stamp, and update the silent trackers."""
        before = self._latest.get(tracker, stamp)
        if stamp > before:
            self._interval[tracker] = stamp - before
        self._latest[tracker] = max(stamp, before)
        self._first_ns = stamp if self._first_ns is None else self._first_ns
        place = bisect_left(self._recent, stamp)
        is_new = stamp not in self._recent[place : place + 1]
        if is_new and (self._overdue_ns is None or stamp > self._overdue_ns):
            self._recent.insert(place, stamp)
            if self.most_waiting is not None and len(self._recent) > self.most_waiting:
                self._recent.pop(0)
        newest, longest_ns = self.newest_ns, self.longest_delay_s * 1e9
        while newest - self._recent[0] > longest_ns:
            self._overdue_ns = self._recent.pop(0)
        if newest - stamp <= longest_ns:
            self._silent.discard(tracker)
        overdue = self._overdue_ns
        if overdue is not None:
            # A tracker without estimates has not reached any stamp.
            self._silent.update(
                k for k in range(self.trackers) if self._latest.get(k, overdue - 1) < overdue
            )

    def _close(self, until_ns: int) -> list[Gathered]:
        stamps = sorted(stamp for stamp in self._pending if stamp <= until_ns)
        self._closed_ns = stamps[-1] if stamps else self._closed_ns
        return [self._pending.pop(stamp) for stamp in stamps]


# Largest number of targets of one stamp, which bounds work and memory.
MOST_TARGETS = 10_000


def fault_of(found: Estimates) -> tuple[str, str] | None:
    """Return why estimates cannot be joined, as a key and a sentence; None if they can.

    Tracks must have unique numbers. Covariances of position and velocity must be positive
    semidefinite, because a distance between two estimates is undefined otherwise. There may be at
    most `MOST_TARGETS` of them.
    """
    # Matching adds this to each axis; half of it belongs to each estimate.
    slack = 0.5
    if len(found) > MOST_TARGETS:
        return "oversize", f"{len(found)} targets, at most {MOST_TARGETS} are allowed"
    tracks, counts = np.unique(found.track_id, return_counts=True)
    if (tracks <= 0).any():
        count = int(counts[tracks <= 0].sum())
        return "unlabelled", (
            f"{count} of {len(found)} targets have track_id 0, must be above 0: a tracker with "
            "engine: phd has no tracks"
        )
    if (counts > 1).any():
        return "schema", f"track_id {tracks[counts > 1][0]} is given twice, must be once"
    axes = [*found.space.position, *found.space.velocity]
    covariance = found.covariance[:, axes][:, :, axes]
    variance = np.einsum("tii->ti", covariance)
    lowest = np.full(len(found), -np.inf)
    usable = (variance >= 0.0).all(axis=1)
    scale = np.sqrt(variance[usable] + slack)
    whole = covariance[usable] + slack * np.eye(len(axes))
    lowest[usable] = np.linalg.eigvalsh(whole / (scale[:, :, None] * scale[:, None]))[:, 0]
    # FLOAT32 rounding does not make an eigenvalue of a correlation matrix smaller than this.
    bad = np.flatnonzero(lowest < -1e-6)
    if len(bad):
        return "covariance", (
            f"the covariance of track {found.track_id[bad[0]]} has a negative eigenvalue, must be "
            "positive semidefinite"
        )
    return None
