"""Out-of-sequence reports, whose scan is already closed: they are dropped or reprocessed.

To reprocess a report, the engine returns to its state before the report's stamp and steps the later
scans again. Published estimates are not revised; estimates not yet published equal those of a run
in which the report was on time.

An out-of-sequence report waits for the next scan. Before that scan, all waiting reports are
reprocessed together, so that each scan causes at most one reprocessing. The mean number of scans
that are stepped again is limited.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..engine import Engine, EngineState, OnFiltered, Step, ignore_filtered
from ..types import Detections, Estimates, Scan, SelfReports
from .sectors import Slice

# Number of reprocessed scans that each new scan pays for.
EARNED = 2.0
# Largest number of reprocessed scans that can be saved up, in windows.
MAX_SAVED = 2.0


class _PendingScan(NamedTuple):
    """A scan with pending smoothed estimates, and the engine's state before it."""

    before: EngineState
    scan: Scan


class OutOfSequence:
    """Steps the engine, and reprocesses reports while smoothed estimates of their time are pending.

    Every scan earns `EARNED`, up to `MAX_SAVED` windows. An out-of-sequence report costs one, plus
    one for each scan that must be stepped again and for each report that must be cut again. Unless
    it `reprocesses`, it keeps no scans: `since_ns` is None and out-of-sequence reports are dropped.
    """

    def __init__(self, engine: Engine, radars: int, reprocesses: bool) -> None:
        self._engine, self._radars, self.reprocesses = engine, radars, reprocesses
        self.forget()

    def forget(self) -> None:
        """Begin a new run: forget all scans and reports."""
        self._pending: list[_PendingScan] = []
        # Changed reports by stamp and radar; None removes a report.
        self._changed: dict[int, dict[int, Detections | None]] = {}
        self._saved = 0.0

    def step(self, scan: Scan, on_filtered: OnFiltered = ignore_filtered) -> Step:
        """Reprocess waiting reports, then step the engine; return the estimates of both, in order.

        Without reprocessing, only step the engine. See `Engine.step` for `on_filtered`.
        """
        if not self.reprocesses:
            return self._engine.step(scan, on_filtered)
        filtered, smoothed = self._reprocess()
        on_filtered(filtered)
        state_before = self._engine.save_state()
        step = self._engine.step(scan, on_filtered)
        self._pending.append(_PendingScan(state_before, scan))
        self._trim(step.smoothed)
        self._saved = min(self._saved + EARNED, MAX_SAVED * (len(self._pending) + 1))
        return replace(
            step, filtered=(*filtered, *step.filtered), smoothed=(*smoothed, *step.smoothed)
        )

    def finish(self) -> tuple[Estimates, ...]:
        """Reprocess waiting reports at the end of a run; return the smoothed estimates due."""
        return self._reprocess()[1]

    def since_ns(self) -> int | None:
        """Return the stamp after which reports can be reprocessed; None if none can.

        It is the last stamp before the window, which includes a run's first scan.
        """
        if not self._pending:
            return None
        state_before, scan = self._pending[0]
        return scan.stamp_ns - 1 if state_before.stamp_ns is None else state_before.stamp_ns

    def spend(self, stamp_ns: int, extra: int) -> bool:
        """Take the cost of reprocessing from this stamp, plus `extra`, from the savings.

        Scans already due for reprocessing are free. Return False, and take nothing, if the savings
        are too small.
        """
        due = self._count_from(min(self._changed)) if self._changed else 0
        cost = max(self._count_from(stamp_ns) - due, 0) + 1 + extra
        if cost > self._saved:
            return False
        self._saved -= cost
        return True

    def insert(self, radar: int, replaced_ns: Sequence[int], reports: Sequence[Slice]) -> None:
        """Insert reports of a radar into closed scans, at the next reprocessing.

        They replace the radar's reports at the stamps `replaced_ns`. Their own stamps are after
        `since_ns`, and not after the last scan.
        """
        stamps = {pending.scan.stamp_ns for pending in self._pending} | self._changed.keys()
        for stamp_ns in replaced_ns:
            if stamp_ns in stamps:
                self._changed.setdefault(stamp_ns, {})[radar] = None
        for stamp_ns, detections in reports:
            self._changed.setdefault(stamp_ns, {})[radar] = detections

    def has_report(self, radar: int, stamp_ns: int) -> bool:
        """Return whether a scan contains, or is about to contain, a report of a radar."""
        waiting = self._changed.get(stamp_ns, {})
        if radar in waiting:
            return waiting[radar] is not None
        scans = (pending.scan for pending in self._pending if pending.scan.stamp_ns == stamp_ns)
        return any(scan.detections[radar] is not None for scan in scans)

    def _count_from(self, stamp_ns: int) -> int:
        """Return the number of pending scans from a stamp on."""
        return len(self._pending) - self._index(stamp_ns)

    def _index(self, stamp_ns: int) -> int:
        """Return the index of the first pending scan that is not before a stamp."""
        return bisect_left([pending.scan.stamp_ns for pending in self._pending], stamp_ns)

    def _reprocess(self) -> tuple[tuple[Estimates, ...], tuple[Estimates, ...]]:
        """Step the changed scans and all later ones again; return the estimates due."""
        if not self._changed:
            return (), ()
        index = self._index(min(self._changed))
        changed = self._changed_scans(self._pending[index:])
        self._changed = {}
        reprocessed = self._engine.reprocess(
            [(pending.before, pending.scan) for pending in changed]
        )
        scans = [pending.scan for pending in changed]
        self._pending[index:] = map(_PendingScan, reprocessed.states, scans)
        self._trim(reprocessed.smoothed)
        return reprocessed.filtered, reprocessed.smoothed

    def _changed_scans(self, pending: Sequence[_PendingScan]) -> list[_PendingScan]:
        """Return scans with the changed reports, each with an engine state.

        The first has the engine's state before it. The states of the others only have the models
        that were in use at their stamps; see `Engine.reprocess`.
        """
        scans = {entry.scan.stamp_ns: entry for entry in pending}
        latest = pending[0].before
        merged: list[_PendingScan] = []
        told: list[SelfReports] = []  # Those of a scan without any report left join the next one's
        for stamp_ns in sorted({*scans, *self._changed}):
            reports: list[Detections | None] = [None] * self._radars
            if stamp_ns in scans:
                latest, scan = scans[stamp_ns]
                reports = list(scan.detections)
                told += [] if scan.self_reports is None else [scan.self_reports]
            for radar, detections in self._changed.get(stamp_ns, {}).items():
                reports[radar] = detections
            if any(report is not None for report in reports):
                state_before = latest if merged else pending[0].before
                joined, told = SelfReports.concatenate(told) if told else None, []
                merged.append(_PendingScan(state_before, Scan(stamp_ns, tuple(reports), joined)))
        return merged

    def _trim(self, smoothed: Sequence[Estimates]) -> None:
        """Drop scans whose smoothed estimates are published."""
        if smoothed:
            latest = smoothed[-1].stamp_ns
            del self._pending[: self._index(latest + 1)]
