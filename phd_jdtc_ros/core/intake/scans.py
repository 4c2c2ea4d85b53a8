"""Groups reports into scans by stamp, and decides when a scan is complete.

Stamps define time; the time of arrival does not matter. Reports with the same stamp form one scan.
A scan is closed when every live radar has reported its stamp, or when a later stamp arrives that
is later by more than a tenth of the interval of any radar that is still due at the scan's. A
radar that has missed two scans is not live until its next report, or until this is due by the
radar's own interval: one that reports once a second is waited for once a second. A caller that
cannot wait for a later stamp closes the pending scans with `close_all`.

A turning radar sends detections that are as old as its report is long. For it, scans are held back:
until every live radar has reported the stamp or a later one, or the newest stamp is later by more
than the longest time that a report covers, with a margin, or than a configured time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

import numpy as np

from ..reports.model import Receiver
from ..types import Detections, Scan, SelfReports

# Number of missed scans, or of own intervals, after which a radar is silent.
MISSES_UNTIL_SILENT = 2
# Share of its interval by which a radar's report may be early or late, and by which longer
# intervals change the estimate, so that missed reports hardly do.
IRREGULAR, FORGETTING = 0.05, 0.1
# Largest number of self-reports that wait; more than a minute of any receiver.
MOST_WAITING = 200_000
# Reasons for which self-reports are not used.
OLD, AHEAD, MANY = "reports_old", "reports_ahead", "reports_many"


class Rejection(Enum):
    """Why a report is not part of any scan."""

    DUPLICATE = "duplicate"
    LATE = "late"
    LATE_BURST = "late_burst"


@dataclass(frozen=True)
class Reset:
    """A jump of the stamps, after which a new run begins."""

    jump_s: float  # Jump from the previous scan or report, seconds; negative for a jump back

    @property
    def ahead(self) -> bool:
        """Whether the jump is forward."""
        return self.jump_s > 0.0

    def __str__(self) -> str:
        way = "ahead" if self.ahead else "back"
        return f"stamps jumped {way} by {abs(self.jump_s):.1f} s"


@dataclass
class ScanGrouper:
    """Groups reports into scans."""

    # Wait for the next report of a turning radar, in times that one covers: it may be delayed by a
    # half of this time.
    HELD: ClassVar[float] = 1.5

    radars: int  # Number of configured radars
    # A stamp that is behind the newest one by more than this begins a new run, seconds. With a
    # smaller difference the report is late.
    reset_threshold_s: float
    # Longest interval between two scans of one run, seconds.
    max_gap_s: float = math.inf
    # Longest time that scans are held back for radars behind the newest stamp, seconds.
    reorder_s: float = 0.0
    # Time that a report of each turning radar covers, seconds: its first detections are so old.
    covered_s: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all stamps; every radar counts as live again."""
        self.closed_ns: int | None = None  # Stamp of the newest closed scan
        self._pending: dict[int, dict[int, Detections]] = {}
        self._misses = [0] * self.radars
        self._last_stamp: list[int | None] = [None] * self.radars
        self._first_stamp: int | None = None
        # Stamp of each radar's newest report, also of a late one, and its interval, nanoseconds.
        self._heard: list[int | None] = [None] * self.radars
        self._interval_ns: list[float | None] = [None] * self.radars

    @property
    def waiting(self) -> bool:
        """Whether any scan is pending."""
        return bool(self._pending)

    def add(
        self, radar: int, stamp_ns: int, detections: Detections
    ) -> list[Scan | Reset] | Rejection:
        """Add one report; return the scans that it closes, oldest first, or why it is part of none.

        A `Reset` stands between the scans of one run and those of the next.
        """
        events = self._after_jump_back(stamp_ns)
        heard, known_ns = self._heard[radar], self._interval_ns[radar]
        if heard is None or stamp_ns > heard:
            self._heard[radar] = stamp_ns
        if heard is not None and stamp_ns > heard:
            # A shorter interval counts at once.
            step_ns = float(stamp_ns - heard)
            slowly_ns = (
                step_ns if known_ns is None else known_ns + FORGETTING * (step_ns - known_ns)
            )
            self._interval_ns[radar] = min(step_ns, slowly_ns)
        last = self._last_stamp[radar]
        if stamp_ns == last or radar in self._pending.get(stamp_ns, ()):
            return Rejection.DUPLICATE
        self._misses[radar] = 0
        if self.closed_ns is not None and stamp_ns <= self.closed_ns:
            return Rejection.LATE
        self._last_stamp[radar] = stamp_ns if last is None else max(last, stamp_ns)
        if self._first_stamp is None:
            self._first_stamp = stamp_ns
        self._pending.setdefault(stamp_ns, {})[radar] = detections
        return events + self._close_complete()

    def add_time(self, stamp_ns: int) -> list[Scan | Reset]:
        """Return a scan of no radar at a stamp, if it is later than the scan before."""
        events = self._after_jump_back(stamp_ns)
        if self.closed_ns is not None and stamp_ns <= self.closed_ns:
            return events
        self._pending[stamp_ns] = {}
        return events + self._close(stamp_ns)

    def _after_jump_back(self, stamp_ns: int) -> list[Scan | Reset]:
        """Return what a jump of the stamps back closes; nothing without one."""
        newest = max(self._pending, default=self.closed_ns)
        if newest is None or stamp_ns >= newest - self.reset_threshold_s * 1e9:
            return []
        events = [*self.close_all(), Reset((stamp_ns - newest) * 1e-9)]
        self.reset()
        return events

    def _is_due(self, radar: int, stamp_ns: int) -> bool:
        """Return whether a radar's next report, or the one after it, has about this stamp."""
        heard, interval_ns = self._heard[radar], self._interval_ns[radar]
        if heard is None or interval_ns is None:
            return False
        since = (stamp_ns - heard) / interval_ns
        return 1.0 - IRREGULAR <= since <= MISSES_UNTIL_SILENT * (1.0 + IRREGULAR)

    def note_live(self, radar: int) -> None:
        """Wait for a radar's next reports, although it has no new one."""
        self._misses[radar] = 0

    def replace(
        self, radar: int, stamps_ns: Sequence[int], reports: Sequence[tuple[int, Detections]]
    ) -> None:
        """Replace a radar's reports of some stamps by new ones, by ascending stamp, at least one.

        Stamps of closed scans are ignored.
        """
        closed_ns = -1 if self.closed_ns is None else self.closed_ns
        for stamp_ns in stamps_ns:
            reports_of_scan = self._pending.get(stamp_ns, {})
            reports_of_scan.pop(radar, None)
            if not reports_of_scan:
                self._pending.pop(stamp_ns, None)
        for stamp_ns, detections in reports:
            if stamp_ns > closed_ns:
                self._pending.setdefault(stamp_ns, {})[radar] = detections
        self._last_stamp[radar] = reports[-1][0]

    def close_all(self) -> list[Scan | Reset]:
        """Close all pending scans, oldest first, even if they are incomplete or held back."""
        return [event for stamp_ns in sorted(self._pending) for event in self._close(stamp_ns)]

    def _close_complete(self) -> list[Scan | Reset]:
        """Close pending scans, oldest first, up to the first one that has to wait."""
        events: list[Scan | Reset] = []
        stamps = sorted(self._pending)
        while stamps and self._closable(stamps):
            events += self._close(stamps.pop(0))
        return events

    @property
    def _wait_ns(self) -> float:
        """The longest time that scans are held back, nanoseconds."""
        covered_s = max(self.covered_s.values(), default=0.0) if self.radars > 1 else 0.0
        return 1e9 * max(self.reorder_s, self.HELD * covered_s)

    def _closable(self, stamps: list[int]) -> bool:
        """Return whether the oldest of the pending stamps need not wait.

        If none is held back, only an incomplete scan waits: for the next stamp, or if that is
        hardly later, also for the radars that are due at its own.
        """
        if self._wait_ns:
            return self._is_final(stamps[0])
        if len(stamps) > 1:
            return not self._is_awaited(stamps[0], stamps[-1])
        return self._is_complete(stamps[0])

    def _is_awaited(self, stamp_ns: int, newest_ns: int) -> bool:
        """Return whether a radar is due at a stamp, and others are hardly later."""
        for radar, interval_ns in enumerate(self._interval_ns):
            heard = self._heard[radar]
            if heard is None or interval_ns is None or heard >= stamp_ns:
                continue
            # Share of a radar's interval by which others' stamps may be later than one that it is
            # due at.
            hardly = 0.1
            if newest_ns - stamp_ns <= hardly * interval_ns and self._is_due(radar, stamp_ns):
                return True
        return False

    def _is_final(self, stamp_ns: int) -> bool:
        """Return whether no live radar can still report a stamp in time.

        A radar is not live if it has sent nothing for `MISSES_UNTIL_SILENT` times the longest wait.
        """
        wait_ns = self._wait_ns
        newest = max(last for last in self._last_stamp if last is not None)
        if newest - stamp_ns > wait_ns:
            return True
        since = newest - MISSES_UNTIL_SILENT * wait_ns
        first = self._first_stamp if self._first_stamp is not None else newest
        for last in self._last_stamp:
            if (first if last is None else last) > since and (last is None or last < stamp_ns):
                return False
        return True

    def _is_complete(self, stamp_ns: int) -> bool:
        live = {
            radar
            for radar in range(self.radars)
            if self._misses[radar] < MISSES_UNTIL_SILENT or self._is_due(radar, stamp_ns)
        }
        return live <= self._pending[stamp_ns].keys()

    def _close(self, stamp_ns: int) -> list[Scan | Reset]:
        """Return the scan, preceded by a reset if it comes after too long a gap."""
        reports = self._pending.pop(stamp_ns)
        for radar, last in enumerate(self._last_stamp):
            # A radar that has already sent a newer report is not silent.
            if radar not in reports and (last is None or last < stamp_ns):
                self._misses[radar] += 1
        gap_ns = 0 if self.closed_ns is None else stamp_ns - self.closed_ns
        self.closed_ns = stamp_ns
        scan = Scan(stamp_ns, tuple(map(reports.get, range(self.radars))))
        return [Reset(gap_ns * 1e-9), scan] if gap_ns > self.max_gap_s * 1e9 else [scan]


class WaitingReports:
    """Self-reports that wait for the scan after their time, in whatever order they came."""

    def __init__(self, receivers: Sequence[Receiver]) -> None:
        self._oldest_ns = np.array([each.max_age_s * 1e9 for each in receivers])
        self.dropped: Counter[str] = Counter()
        self.clear()

    def clear(self) -> None:
        """Forget all reports."""
        self._waiting: list[SelfReports] = []

    def add(self, receiver: int, reports: SelfReports) -> None:
        """Add reports of a receiver, up to `MOST_WAITING` in all; others are counted as dropped."""
        if not len(reports):
            return
        waiting = sum(map(len, self._waiting))
        if waiting + len(reports) > MOST_WAITING:
            kept = max(MOST_WAITING - waiting, 0)
            self.dropped[MANY] += len(reports) - kept
            reports = reports.take(np.arange(kept))
        self._waiting.append(reports.changed(receiver=np.full(len(reports), receiver)))

    def passed_ns(self, interval_ns: int) -> int | None:
        """Return the last multiple of an interval that two reports have passed; None without two.

        A single report with a wrong time ahead moves no clock.
        """
        times = np.concatenate([each.time_ns for each in self._waiting] or [np.zeros(0, np.int64)])
        if len(times) < 2:
            return None
        return int(np.partition(times, -2)[-2]) // interval_ns * interval_ns

    def take(self, stamp_ns: int) -> SelfReports | None:
        """Return the reports up to a stamp, and those of wrong times; None without any.

        The latter, too old or ahead, are counted as dropped: they show that their transmitters are
        on, and nothing else.
        """
        if not self._waiting:
            return None
        found = SelfReports.concatenate(self._waiting)
        age_ns = stamp_ns - found.time_ns
        old = age_ns > self._oldest_ns[found.receiver]
        # Self-reports that are ahead of the scans by more than this have a wrong time, seconds.
        ahead = age_ns < -60.0 * 1e9
        for reason, mask in ((OLD, old), (AHEAD, ahead)):
            if mask.any():
                self.dropped[reason] += int(mask.sum())
        later = np.flatnonzero((age_ns < 0) & ~ahead)
        self._waiting = [found.take(later)] if len(later) else []
        due = np.flatnonzero((age_ns >= 0) | ahead)
        return found.take(due) if len(due) else None

    def take_dropped(self) -> Counter[str]:
        """Return the numbers of unused reports since the last call, by reason."""
        taken = +self.dropped
        self.dropped.clear()
        return taken
