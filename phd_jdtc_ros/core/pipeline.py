"""The pipeline from reports to estimates, which the live node and the offline tracker share.

Reports of turning radars are cut into slices, reports of moving radars get the pose of their radar,
reports are grouped into scans, scans step the engine, and jumps of the stamps end runs. The live
node publishes the estimates, and the offline tracker writes them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

from .engine import Engine, Step
from .intake.input_checks import ReportWatch, ResultWatch
from .intake.out_of_sequence import DropLateReports, LateReports
from .intake.posed_reports import PosedReports
from .intake.poses import Platform, PoseFault
from .intake.scans import Rejection, Reset, ScanGrouper
from .intake.turn_history import Recut, TurnHistory
from .intake.turns import Piece, Turns
from .models.tracker_model import TrackerModel
from .tracks.region import Everywhere, Region, within
from .tracks.reporting_rule import ReportingRule, slowest_s
from .types import Detections, Estimates, Pose, Scan


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan.

    Parameters
    ----------
    overdue : int
        Number of scans with detections but without any target, if it warrants a warning; else 0.
    """

    scan: Scan
    step: Step
    overdue: int = 0


@dataclass(frozen=True)
class RunEnded:
    """The stamps jumped, or the run was flushed; later events belong to a new run.

    Parameters
    ----------
    reset : Reset or None
        The jump; None if the run was flushed.
    smoothed : tuple of Estimates
        Pending smoothed estimates, oldest first.
    """

    reset: Reset | None
    smoothed: tuple[Estimates, ...]


# Counts reports of moving radars that are dropped because the radar's pose is unknown.
POSE_MISSING = "pose_missing"
# Counts reports, or slices of turns, of closed scans that are reprocessed.
LATE_REWORKED = "late_reworked"
EVERYWHERE = Everywhere()

Event: TypeAlias = "Stepped | RunEnded"


def start_cold(engine: Engine, stamp_ns: int) -> None:
    """Start a run without restoring the engine."""


class Pipeline:
    """Groups reports into scans and steps the engine through them.

    Its methods return iterators: a scan is stepped when its event is requested, so that its
    estimates can be published before the next scan is stepped. Every iterator must be exhausted
    before the next call.

    Parameters
    ----------
    begin : callable
        Called with the engine and the stamp of a run's first scan before that scan is stepped; it
        may restore the engine.
    turns : sequence of Turns
        Slicer of each radar's turns, in the configured order; empty if no report is cut.
    watches : sequence of ReportWatch
        Input checks of each radar, in the configured order; empty for none.
    platforms : sequence of (Platform or None)
        Platform of each radar, in the configured order, None for a fixed radar; empty if all are
        fixed.
    late : LateReports or None
        Policy for reports of closed scans, with the same engine; None to drop them.
    histories : mapping of int to TurnHistory
        Histories, by radar index, of the turning radars whose out-of-sequence reports are recut;
        they share their `turns`.
    region : Region or Everywhere
        Region in which detections are used and targets reported.
    tuned : tuple of (TrackerModel, ReportingRule) or None
        The engine's model and rule, which the pipeline adapts to the estimated antenna rotation;
        required with a region. None to leave the engine unchanged.
    """

    def __init__(
        self,
        grouper: ScanGrouper,
        engine: Engine,
        begin: Callable[[Engine, int], None] = start_cold,
        turns: Sequence[Turns] = (),
        watches: Sequence[ReportWatch] = (),
        results: ResultWatch | None = None,
        platforms: Sequence[Platform | None] = (),
        late: LateReports | None = None,
        histories: Mapping[int, TurnHistory] = MappingProxyType({}),
        region: Region | Everywhere = EVERYWHERE,
        tuned: tuple[TrackerModel, ReportingRule] | None = None,
    ) -> None:
        self.engine = engine
        self._turns = tuple(turns) or tuple(Turns() for _ in range(grouper.radars))
        self._watches = tuple(watches) or tuple(ReportWatch() for _ in range(grouper.radars))
        self._results = results or ResultWatch(math.inf)
        self._grouper = grouper
        self._late = late or DropLateReports(engine, grouper.radars)
        self._histories = histories
        self._region, self._tuned = region, tuned
        self._posed = PosedReports(platforms)
        self._drops: list[Counter[str]] = [Counter() for _ in range(grouper.radars)]
        self._begin = begin
        self._begun = False

    @property
    def waiting(self) -> bool:
        """Whether a report is pending: its scan is not complete, or its pose is not known."""
        return self._grouper.waiting or self._posed.waiting

    @property
    def awaited_pose(self) -> int | None:
        """The radar whose oldest pending report waits for a pose; None if none waits.

        Later reports wait behind it.
        """
        return self._posed.awaited

    def add(
        self, radar: int, stamp_ns: int, detections: Detections, sector: int | None = None
    ) -> Iterator[Event] | Rejection:
        """Add one report.

        Parameters
        ----------
        radar : int
            Index in the configured order.
        sector : int or None
            Sector number, if the report contains it.

        Returns
        -------
        iterator of Event
        Rejection
            If no part of the report is used in any scan.
        """
        turns = self._turns[radar]
        noticed = self._watches[radar].add(detections)
        if turns.turn_s:
            del noticed["sectors_not_configured"]
        turns.doubts += noticed
        history, usual_s = self._histories.get(radar), turns.usual_s
        pieces: list[Piece] | Rejection
        if history is None:
            pieces = turns.split(stamp_ns, detections, sector)
        elif usual_s and turns.behind(stamp_ns) and self._late.since_ns() is not None:
            pieces = self._insert(radar, stamp_ns, detections, sector)
        else:
            pieces = history.split(stamp_ns, detections, sector)
        if turns.usual_s != usual_s:
            self._turning()
        if isinstance(pieces, Rejection):
            return pieces
        if self._posed.moving:
            self._posed.add(radar, pieces)
            return self._events(self._released())
        closed: list[Scan | Reset] = []
        rejected = []
        for piece_ns, piece in pieces:
            found = self._group(radar, piece_ns, piece)
            if isinstance(found, Rejection):
                rejected.append(found)
            else:
                closed += found
        if rejected and len(rejected) == len(pieces):
            return rejected[0]
        turns.doubts["slices_late"] += len(rejected)
        return self._events(closed)

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model and rule from the next scan on; their structure must be the same."""
        self._tuned = model, rule
        self._turning()

    def _turning(self) -> None:
        """Adapt the engine's model and rule to the antennas' estimated rotation times."""
        if self._tuned is None:
            return
        model, rule = self._tuned
        radars = tuple(
            radar.turning_in(turns.usual_s or radar.rotation_s)
            for radar, turns in zip(model.radars, self._turns, strict=True)
        )
        turning = replace(model, radars=radars)
        self.engine.retune(turning, rule.slower(slowest_s(turning) / slowest_s(model)))

    def turn_s(self, radar: int) -> float:
        """Return the rotation time of a radar as estimated from its detections, s; 0 for none."""
        return self._turns[radar].turn_s

    def turn_found_s(self, radar: int) -> float:
        """Return the estimated rotation time, s, of a radar without a configured one; else 0."""
        turns = self._turns[radar]
        return 0.0 if turns.rotation_s else turns.state.found_s

    def _group(
        self, radar: int, stamp_ns: int, detections: Detections
    ) -> list[Scan | Reset] | Rejection:
        """Add a report, or a slice of one, to its scan; return the scans that this closes."""
        detections = self._inside(radar, detections)
        found = self._grouper.add(radar, stamp_ns, detections)
        if found is not Rejection.LATE:
            return found
        since_ns, closed_ns = self._late.since_ns(), self._grouper.closed_ns
        if since_ns is None or closed_ns is None or not since_ns < stamp_ns <= closed_ns:
            return Rejection.LATE
        if self._late.reported(radar, stamp_ns):
            return Rejection.DUPLICATE
        if not self._late.afford(stamp_ns, 0):
            return Rejection.LATE_BURST
        self._late.place(radar, (), [(stamp_ns, detections)])
        self._turns[radar].doubts[LATE_REWORKED] += 1
        return []

    def _insert(
        self, radar: int, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Piece] | Rejection:
        """Recut the turns of a radar with an out-of-sequence report; no slice is left pending."""
        turns, history = self._turns[radar], self._histories[radar]
        later = history.later(stamp_ns)
        if isinstance(later, Rejection):
            return later
        since_ns, closed_ns = self._late.since_ns(), self._grouper.closed_ns
        if since_ns is None or closed_ns is None or stamp_ns <= since_ns:
            return Rejection.LATE
        longest_ns = round((turns.report_s or turns.turn_s) * 1e9)
        if not self._late.afford(stamp_ns - longest_ns, later):
            return Rejection.LATE_BURST
        recut = history.insert(stamp_ns, detections, sector)
        self._replace(radar, recut, since_ns, closed_ns)
        turns.doubts[LATE_REWORKED] += 1
        return []

    def _replace(self, radar: int, recut: Recut, since_ns: int, closed_ns: int) -> None:
        """Replace the slices that were cut without an out-of-sequence report by the recut ones."""
        pieces = [(stamp_ns, self._inside(radar, piece)) for stamp_ns, piece in recut.pieces]
        self._grouper.replace(radar, recut.stamps_ns, pieces)
        closed = [piece for piece in pieces if since_ns < piece[0] <= closed_ns]
        self._turns[radar].doubts["slices_late"] += sum(piece[0] <= since_ns for piece in pieces)
        self._late.place(radar, recut.stamps_ns, closed)

    def _inside(self, radar: int, detections: Detections) -> Detections:
        """Return the detections of a radar within the region."""
        if isinstance(self._region, Everywhere) or self._tuned is None:
            return detections
        return self._region.select_detections(detections, self._tuned[0].radars[radar])

    def add_pose(self, radar: int, stamp_ns: int, pose: Pose) -> Iterator[Event] | PoseFault:
        """Add a pose of a radar's platform.

        Parameters
        ----------
        radar : int
            Index of a moving radar in the configured order.

        Returns
        -------
        iterator of Event
            Events of the scans that waited for the pose.
        PoseFault
            If the pose is rejected.
        """
        fault = self._posed.add_pose(radar, stamp_ns, pose)
        return fault if fault is not None else self._events(self._released())

    def take_drops(self, radar: int) -> Counter[str]:
        """Return the counts, by reason, of reports dropped after `add` since the last call.

        Only reports of moving radars are dropped after `add`, since they wait for their poses.
        """
        taken, self._drops[radar] = self._drops[radar], Counter()
        return taken

    def _released(self, everything: bool = False) -> list[Scan | Reset]:
        """Return the scans closed by reports that no longer wait for poses, or by all reports."""
        closed: list[Scan | Reset] = []
        for report in self._posed.released(everything):
            if report.detections is None:
                self._drops[report.radar][POSE_MISSING] += 1
                continue
            if report.extrapolated:
                self._turns[report.radar].doubts["poses_extrapolated"] += 1
            found = self._group(report.radar, report.stamp_ns, report.detections)
            if isinstance(found, Rejection):
                self._drops[report.radar][found.value] += 1
            else:
                closed += found
        return closed

    def take_doubts(self, radar: int) -> Counter[str]:
        """Return the counts of a radar's input warnings since the last call."""
        doubts = self._turns[radar].doubts
        taken = +doubts
        doubts.clear()
        return taken

    def close_scans(self) -> Iterator[Event]:
        """Close all scans, complete or not, and step the engine through them."""
        return self._events([*self._released(everything=True), *self._grouper.close_all()])

    def flush(self) -> Iterator[Event]:
        """Close all scans, step the engine through them, and end the run."""
        yield from self.close_scans()
        self._forget_stamps()
        yield self._end(None)

    def reset(self) -> None:
        """Discard all scans and return the engine to its initial state."""
        self._forget_stamps()
        self._late.forget()
        self.engine.reset()
        self._begun = False

    def _forget_stamps(self) -> None:
        self._grouper.reset()
        self._posed.forget()
        for turns in self._turns:
            turns.reset()
        for history in self._histories.values():
            history.clear()

    def _events(self, closed: Sequence[Scan | Reset]) -> Iterator[Event]:
        for event in closed:
            if isinstance(event, Reset):
                yield self._end(event)
                continue
            if not self._begun:
                self._begin(self.engine, event.stamp_ns)
                self._begun = True
            step = self._reported(self._late.step(event))
            since_ns = self._late.since_ns()
            for history in self._histories.values():
                history.forget_before(event.stamp_ns if since_ns is None else since_ns)
            overdue = self._results.stepped(event, step)
            yield Stepped(event, step, self._results.scans if overdue else 0)

    def _reported(self, step: Step) -> Step:
        """Return a step with only the estimates within the region."""
        if isinstance(self._region, Everywhere):
            return step
        filtered, smoothed = (within(self._region, own) for own in (step.filtered, step.smoothed))
        return replace(step, filtered=filtered, smoothed=smoothed)

    def _end(self, reset: Reset | None) -> RunEnded:
        """End the run; after a jump ahead, track numbers are not reused."""
        ahead = reset is not None and reset.ahead
        due = self._late.finish()
        rest = self.engine.interrupt() if ahead else self.engine.flush()
        self._late.forget()
        self._begun = False
        return RunEnded(reset, within(self._region, (*due, *rest)))
