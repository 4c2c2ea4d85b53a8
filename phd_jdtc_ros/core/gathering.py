# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Gathers what several trackers say of one stamp, and decides when no more of it can come.

Time is given by stamps, never by arrival: the same estimates are gathered in the same way however
their topics are delayed among each other. A stamp is closed once every tracker has reported it or a
later one. One whose latest stamp is older than the newest of all by more than the longest delay is
silent: the others do not wait for it until it has caught up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from .types import Estimates

# Those of one stamp, by the index of their tracker.
Gathered = Mapping[int, Estimates]


class Refused(Enum):
    """Why estimates are not part of what is gathered."""

    DUPLICATE = "duplicate"
    LATE = "late"


@dataclass
class Gathering:
    """Gathers the estimates of one kind.

    Parameters
    ----------
    trackers : int
        How many there are.
    longest_delay_s : float
        How much older than the newest of all a tracker's latest stamp may be, seconds; infinite for
        recordings, all of which is there.
    """

    trackers: int
    longest_delay_s: float
    _pending: dict[int, dict[int, Estimates]] = field(init=False, default_factory=dict)
    _latest: dict[int, int] = field(init=False, default_factory=dict)
    _first_ns: int | None = field(init=False, default=None)
    _closed_ns: int | None = field(init=False, default=None)

    @property
    def silent(self) -> frozenset[int]:
        """The trackers that are not waited for."""
        return frozenset(k for k in range(self.trackers) if self.behind_s(k) > self.longest_delay_s)

    def behind_s(self, tracker: int) -> float:
        """Return how much older a tracker's latest stamp is than the newest of all, seconds.

        One that has said nothing is as old as the first stamp.
        """
        if self._first_ns is None:
            return 0.0
        newest = max(self._latest.values())
        return (newest - self._latest.get(tracker, self._first_ns)) * 1e-9

    def jumps_back(self, tracker: int, stamp_ns: int) -> bool:
        """Return whether a stamp begins a new run: a tracker's own stamps do not fall in one."""
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
        if found.stamp_ns == self._latest.get(tracker):
            return Refused.DUPLICATE
        self._latest[tracker] = found.stamp_ns
        self._first_ns = found.stamp_ns if self._first_ns is None else self._first_ns
        if self._closed_ns is not None and found.stamp_ns <= self._closed_ns:
            return Refused.LATE
        self._pending.setdefault(found.stamp_ns, {})[tracker] = found
        silent = self.silent
        awaited = [self._latest.get(k) for k in range(self.trackers) if k not in silent]
        # The newest is never silent, so that one is waited for at least.
        until = None if None in awaited else min(stamp for stamp in awaited if stamp is not None)
        return [] if until is None else self._close(until)

    def close_all(self) -> list[Gathered]:
        """Close all stamps, oldest first, and begin a new run."""
        closed = self._close(max(self._pending, default=0))
        self._latest, self._first_ns, self._closed_ns = {}, None, None
        return closed

    def _close(self, until_ns: int) -> list[Gathered]:
        stamps = sorted(stamp for stamp in self._pending if stamp <= until_ns)
        self._closed_ns = stamps[-1] if stamps else self._closed_ns
        return [self._pending.pop(stamp) for stamp in stamps]
