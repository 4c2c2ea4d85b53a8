"""Gathers what several trackers say of one stamp, and decides when no more of it can come.

Time is given by stamps, never by arrival: the same estimates are gathered in the same way however
their topics are delayed among each other. A stamp is closed once every tracker has reported it or a
later one. A stamp waits for the longest delay at most: once the newest of all is later by more, it
is overdue, and the trackers that have not reached it are silent. The others do not wait for them
until they report a stamp that is not that old.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum

from phd_jdtc_ros.core.types import Estimates

# Those of one stamp, by the index of their tracker.
Gathered = Mapping[int, Estimates]
# Where the number of stamps that wait is bounded, so many targets may wait with each, on average.
TARGETS_OF_A_STAMP = 100


def too_many(waiting: Collection[Gathered], most: int | None) -> bool:
    """Return whether more stamps wait than are to, or more targets with them; one always may."""
    if most is None or len(waiting) < 2:
        return False
    targets = sum(len(own) for gathered in waiting for own in gathered.values())
    return len(waiting) > most or targets > most * TARGETS_OF_A_STAMP


class Refused(Enum):
    """Why estimates are not part of what is gathered."""

    DUPLICATE = "duplicate"
    LATE = "late"


@dataclass
class Gathering:
    """Gathers the estimates of one kind and of one run.

    Parameters
    ----------
    trackers : int
        How many there are.
    longest_delay_s : float
        How much older than the newest of all a stamp may become while it waits for a tracker,
        seconds; infinite for recordings, all of which is there.
    most_waiting : int or None
        How many stamps may wait; with more of them, see `too_many`, the oldest no longer waits for
        its trackers. None for any number.

    Attributes
    ----------
    overflow : int
        How many stamps were closed because too many waited.
    """

    trackers: int
    longest_delay_s: float
    most_waiting: int | None = None
    overflow: int = field(init=False, default=0)
    _pending: dict[int, dict[int, Estimates]] = field(init=False, default_factory=dict)
    _latest: dict[int, int] = field(init=False, default_factory=dict)
    _interval: dict[int, int] = field(init=False, default_factory=dict)
    _first_ns: int | None = field(init=False, default=None)
    _closed_ns: int | None = field(init=False, default=None)
    # The stamps that were heard of and are not overdue, ascending; the newest one that is overdue.
    _recent: list[int] = field(init=False, default_factory=list)
    _overdue_ns: int | None = field(init=False, default=None)
    _silent: set[int] = field(init=False, default_factory=set)

    @property
    def silent(self) -> frozenset[int]:
        """The trackers that are not waited for."""
        return frozenset(self._silent)

    @property
    def newest_ns(self) -> int:
        """The newest stamp of all; 0 before the first."""
        return max(self._latest.values(), default=0)

    def latest_ns(self, tracker: int) -> int | None:
        """Return a tracker's latest stamp, also one that was refused; None before its first."""
        return self._latest.get(tracker)

    def expected_ns(self, at_most_ns: float = math.inf) -> dict[int, float]:
        """Return until which stamp there may be something of each tracker on its way, nanoseconds.

        That is the longest delay after the stamp that its last interval leads to. A tracker that
        has said nothing is not in it.
        """
        longest_ns = self.longest_delay_s * 1e9
        return {
            tracker: min(latest + self._interval.get(tracker, 0) + longest_ns, at_most_ns)
            for tracker, latest in self._latest.items()
        }

    def behind_s(self, tracker: int) -> float:
        """Return how much older a tracker's latest stamp is than the newest of all, seconds.

        One that has said nothing is as old as the first stamp.
        """
        if self._first_ns is None:
            return 0.0
        return (self.newest_ns - self._latest.get(tracker, self._first_ns)) * 1e-9

    def jumps_back(self, tracker: int, stamp_ns: int) -> bool:
        """Return whether a stamp is older than the tracker's latest one."""
        return stamp_ns < self._latest.get(tracker, stamp_ns)

    def add(self, tracker: int, found: Estimates) -> list[Gathered] | Refused:
        """Take in the estimates of a tracker.

        Returns
        -------
        list of mappings of tracker to Estimates
            What is closed by this, a mapping for each stamp, oldest first; without those trackers
            that say nothing of it.
        Refused
            If the stamp is closed already, or the tracker has said something of it.
        """
        stamp = found.stamp_ns
        if stamp == self._latest.get(tracker) or tracker in self._pending.get(stamp, {}):
            return Refused.DUPLICATE
        self._hear(tracker, stamp)
        if self._closed_ns is not None and stamp <= self._closed_ns:
            return Refused.LATE
        self._pending.setdefault(stamp, {})[tracker] = found
        # The newest is never silent, so that one is waited for at least.
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

    def _hear(self, tracker: int, stamp: int) -> None:
        """Note a tracker's stamp, and find out who is silent."""
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
            # A tracker that has said nothing yet has not reached any stamp.
            self._silent.update(
                k for k in range(self.trackers) if self._latest.get(k, overdue - 1) < overdue
            )

    def _close(self, until_ns: int) -> list[Gathered]:
        stamps = sorted(stamp for stamp in self._pending if stamp <= until_ns)
        self._closed_ns = stamps[-1] if stamps else self._closed_ns
        return [self._pending.pop(stamp) for stamp in stamps]
