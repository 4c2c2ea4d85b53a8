"""Grouping reports by stamp: which reports make one scan, and when it is complete.

Time is stamps, never arrival. Reports of several radars with one stamp are one scan; a radar with
a stamp of its own makes a scan of its own. A scan is closed when every live radar has reported
its stamp, or as soon as a later stamp has come. A radar is live by its stamps: it stops being
waited for once it has missed two scans, and is waited for again from its next report on. Whoever
must not wait for a later stamp closes what waits with `close_all`, when it likes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from .types import Detections, Scan

MISSES_UNTIL_SILENT = 2


class Rejection(Enum):
    """Why a report is not part of any scan."""

    DUPLICATE = "duplicate"
    LATE = "late"


class Reset:
    """The stamps jumped back: what follows belongs to a new run."""


@dataclass
class ScanGrouper:
    """Groups reports into scans.

    Parameters
    ----------
    radars : int
        How many radars are configured.
    reset_threshold_s : float
        A stamp further back than this behind the newest is a new run and not a late report.
    """

    radars: int
    reset_threshold_s: float
    _pending: dict[int, dict[int, Detections]] = field(init=False, default_factory=dict)
    _misses: list[int] = field(init=False)
    _last_stamp: list[int | None] = field(init=False)
    _closed_ns: int | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all stamps; every radar counts as live again."""
        self._pending = {}
        self._misses = [0] * self.radars
        self._last_stamp = [None] * self.radars
        self._closed_ns = None

    @property
    def waiting(self) -> bool:
        """Whether a report is held back until its scan is complete."""
        return bool(self._pending)

    def add(
        self, radar: int, stamp_ns: int, detections: Detections
    ) -> list[Scan | Reset] | Rejection:
        """Take in one report.

        Parameters
        ----------
        radar : int
            Index in the configured order.
        stamp_ns : int
        detections : Detections

        Returns
        -------
        list of Scan or Reset
            The scans that this report closes, oldest first. A `Reset` among them parts the scans
            of the old run from what follows.
        Rejection
            If the report is not part of any scan.
        """
        events: list[Scan | Reset] = []
        newest = max(self._pending, default=self._closed_ns)
        if newest is not None and stamp_ns < newest - self.reset_threshold_s * 1e9:
            events = [*self.close_all(), Reset()]
            self.reset()
        last = self._last_stamp[radar]
        if stamp_ns == last or radar in self._pending.get(stamp_ns, ()):
            return Rejection.DUPLICATE
        self._misses[radar] = 0
        if self._closed_ns is not None and stamp_ns <= self._closed_ns:
            return Rejection.LATE
        self._last_stamp[radar] = stamp_ns if last is None else max(last, stamp_ns)
        self._pending.setdefault(stamp_ns, {})[radar] = detections
        return events + self._close_complete()

    def close_all(self) -> list[Scan | Reset]:
        """Close every pending scan, complete or not, oldest first."""
        return [self._close(stamp_ns) for stamp_ns in sorted(self._pending)]

    def _close_complete(self) -> list[Scan | Reset]:
        *older, newest = sorted(self._pending)
        closed: list[Scan | Reset] = [self._close(stamp_ns) for stamp_ns in older]
        live = {r for r in range(self.radars) if self._misses[r] < MISSES_UNTIL_SILENT}
        if live <= self._pending[newest].keys():
            closed.append(self._close(newest))
        return closed

    def _close(self, stamp_ns: int) -> Scan:
        reports = self._pending.pop(stamp_ns)
        for radar, last in enumerate(self._last_stamp):
            # A radar whose newer report is already here is late for nothing.
            if radar not in reports and (last is None or last < stamp_ns):
                self._misses[radar] += 1
        self._closed_ns = stamp_ns
        return Scan(stamp_ns, tuple(reports.get(radar) for radar in range(self.radars)))
