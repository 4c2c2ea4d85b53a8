"""What becomes of reports that come after their scan was closed: dropped, or worked in.

To work a report in, the engine returns to its state before the report's stamp, and the scans
since are stepped again with it. What has been given out is not taken back; what is still to come is
what it would have been had the report come in time.

A late report waits for the next scan, before which all that have come since the last one are
worked in at once. So there is at most one rework for each scan. How many scans are stepped again is
limited in the long run, whatever comes: see `Budget`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

from ..engine import Engine, EngineState, Step
from ..types import Detections, Estimates, Scan

# Every scan pays for so many to be stepped again, and so many windows can be saved.
EARNED, SAVED = 2.0, 2.0

Report = tuple[int, Detections]


@dataclass
class Budget:
    """Limits the work for late reports.

    Every scan earns `EARNED`, up to `SAVED` windows. A late report costs one, and one for every
    scan that must be stepped again because of it, and for every report that is cut again.
    """

    saved: float = 0.0

    def earn(self, window: int) -> None:
        """Take in what a scan earns, given the number of scans that can be stepped again."""
        self.saved = min(self.saved + EARNED, SAVED * (window + 1))

    def spend(self, cost: int) -> bool:
        """Spend so much and return True; return False if there is less."""
        if cost > self.saved:
            return False
        self.saved -= cost
        return True


class LateReports(Protocol):
    """Steps an engine, and decides on reports of closed scans."""

    def step(self, scan: Scan) -> Step:
        """Step the engine; what late reports made due comes first."""
        ...

    def finish(self) -> tuple[Estimates, ...]:
        """Return the smoothed estimates that late reports have made due, at the end of a run."""
        ...

    def since_ns(self) -> int | None:
        """Return the stamp after which reports can still be worked in; None if none can."""
        ...

    def afford(self, stamp_ns: int, more: int) -> bool:
        """Pay for a late report of a stamp, and `more` beside; return whether that was possible."""
        ...

    def place(self, radar: int, replaced_ns: Sequence[int], reports: Sequence[Report]) -> None:
        """Put reports of a radar in closed scans, in place of others.

        Parameters
        ----------
        radar : int
            Index in the configured order.
        replaced_ns : sequence of int
            Stamps of those that are replaced.
        reports : sequence of (stamp in nanoseconds, Detections)
            All after `since_ns`, and not after the last scan.
        """
        ...

    def reported(self, radar: int, stamp_ns: int) -> bool:
        """Return whether a radar's report is in the scan of a stamp."""
        ...

    def forget(self) -> None:
        """Begin a new run."""
        ...


class Dropped:
    """Late reports are dropped.

    Parameters
    ----------
    engine : Engine
    radars : int
        How many are configured.
    """

    def __init__(self, engine: Engine, radars: int) -> None:
        self._engine = engine

    def step(self, scan: Scan) -> Step:
        """Step the engine."""
        return self._engine.step(scan)

    def finish(self) -> tuple[Estimates, ...]:
        """Return nothing."""
        return ()

    def since_ns(self) -> int | None:
        """Return None."""
        return None

    def afford(self, stamp_ns: int, more: int) -> bool:
        """Return False."""
        return False

    def place(self, radar: int, replaced_ns: Sequence[int], reports: Sequence[Report]) -> None:
        """Do nothing: nothing can be afforded."""

    def reported(self, radar: int, stamp_ns: int) -> bool:
        """Return False."""
        return False

    def forget(self) -> None:
        """Do nothing."""


class _Kept(NamedTuple):
    """A scan whose smoothed estimates are still to come, and the engine's state before it."""

    before: EngineState
    scan: Scan


@dataclass
class Reworked:
    """Late reports are worked in, as long as smoothed estimates of their time are to come.

    Parameters
    ----------
    engine : Engine
    radars : int
        How many are configured.
    """

    engine: Engine
    radars: int
    _kept: list[_Kept] = field(init=False, default_factory=list)
    # By stamp and radar; None where a report is taken out.
    _changed: dict[int, dict[int, Detections | None]] = field(init=False, default_factory=dict)
    _budget: Budget = field(init=False, default_factory=Budget)

    def step(self, scan: Scan) -> Step:
        """Work in what has come late, and step the engine."""
        filtered, smoothed = self._work_in()
        before = self.engine.save_state()
        step = self.engine.step(scan)
        self._kept.append(_Kept(before, scan))
        self._trim(step.smoothed)
        self._budget.earn(len(self._kept))
        if not (filtered or smoothed):
            return step
        return replace(
            step,
            filtered=(*filtered, *step.filtered),
            smoothed=(*smoothed, *step.smoothed),
        )

    def finish(self) -> tuple[Estimates, ...]:
        """Work in what has come late."""
        return self._work_in()[1]

    def since_ns(self) -> int | None:
        """Return the stamp before the window; that of a run's first scan itself is in it."""
        if not self._kept:
            return None
        before, scan = self._kept[0]
        return scan.stamp_ns - 1 if before.stamp_ns is None else before.stamp_ns

    def afford(self, stamp_ns: int, more: int) -> bool:
        """Pay for a late report; scans that are stepped again anyway cost nothing more."""
        anyway = self._since(min(self._changed)) if self._changed else 0
        return self._budget.spend(max(self._since(stamp_ns) - anyway, 0) + 1 + more)

    def place(self, radar: int, replaced_ns: Sequence[int], reports: Sequence[Report]) -> None:
        """Note the change for the next rework."""
        stamps = {kept.scan.stamp_ns for kept in self._kept} | self._changed.keys()
        for stamp_ns in replaced_ns:
            if stamp_ns in stamps:
                self._changed.setdefault(stamp_ns, {})[radar] = None
        for stamp_ns, detections in reports:
            self._changed.setdefault(stamp_ns, {})[radar] = detections

    def reported(self, radar: int, stamp_ns: int) -> bool:
        """Return whether a radar's report is in the scan of a stamp, or is to be."""
        waiting = self._changed.get(stamp_ns, {})
        if radar in waiting:
            return waiting[radar] is not None
        scans = (kept.scan for kept in self._kept if kept.scan.stamp_ns == stamp_ns)
        return any(scan.detections[radar] is not None for scan in scans)

    def forget(self) -> None:
        """Forget all scans and reports."""
        self._kept, self._changed, self._budget = [], {}, Budget()

    def _since(self, stamp_ns: int) -> int:
        """Return the number of scans from a stamp on."""
        return len(self._kept) - self._place(stamp_ns)

    def _place(self, stamp_ns: int) -> int:
        """Return the number of scans before a stamp."""
        return bisect_left([kept.scan.stamp_ns for kept in self._kept], stamp_ns)

    def _work_in(self) -> tuple[tuple[Estimates, ...], tuple[Estimates, ...]]:
        """Step the changed scans and all later ones again; return what has become due."""
        if not self._changed:
            return (), ()
        place = self._place(min(self._changed))
        again = self._merged(self._kept[place:])
        self._changed = {}
        done = self.engine.rework([(kept.before, kept.scan) for kept in again])
        scans = [kept.scan for kept in again]
        self._kept[place:] = map(_Kept, done.states, scans)
        self._trim(done.smoothed)
        return done.filtered, done.smoothed

    def _merged(self, kept: Sequence[_Kept]) -> list[_Kept]:
        """Return scans with what has changed; the first has the engine's state before it."""
        scans = {own.scan.stamp_ns: own for own in kept}
        tuned = kept[0].before
        merged: list[_Kept] = []
        for stamp_ns in sorted({*scans, *self._changed}):
            tuned = scans[stamp_ns].before if stamp_ns in scans else tuned
            reports: list[Detections | None] = [None] * self.radars
            if stamp_ns in scans:
                reports = list(scans[stamp_ns].scan.detections)
            for radar, detections in self._changed.get(stamp_ns, {}).items():
                reports[radar] = detections
            if any(report is not None for report in reports):
                before = tuned if merged else kept[0].before
                merged.append(_Kept(before, Scan(stamp_ns, tuple(reports))))
        return merged

    def _trim(self, smoothed: Sequence[Estimates]) -> None:
        """Forget scans whose smoothed estimates have been given out."""
        if smoothed:
            latest = smoothed[-1].stamp_ns
            del self._kept[: self._place(latest + 1)]


LATE_REPORTS: dict[str, Callable[[Engine, int], LateReports]] = {
    "drop": Dropped,
    "rework": Reworked,
}
