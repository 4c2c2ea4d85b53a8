"""The pipeline from reports to estimates, which the live node and the offline tracker share.

Reports of turning radars are cut into slices, reports of moving radars get the pose of their radar,
reports are grouped into scans, the engine is stepped through the scans, and a jump of the stamps
ends a run. The live node publishes the estimates, and the offline tracker writes them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

from .engine import Engine, OnFiltered, Step, ignore_filtered
from .intake.clocks import CLOCK, Clocks, SentReport
from .intake.input_checks import (
    CONSTANT,
    NO_SECTORS,
    REPEATED,
    TWINS,
    ReportCheck,
    ResultCheck,
    TwinCheck,
)
from .intake.out_of_sequence import OutOfSequence
from .intake.posed_reports import Platform, PosedReports
from .intake.poses import PoseFault
from .intake.revolution_history import Recut, RevolutionHistory
from .intake.scans import Rejection, Reset, ScanGrouper, WaitingReports
from .intake.sectors import Slice
from .models.tracker_model import TrackerModel
from .tracks.manual import START, Command, Manual
from .tracks.region import Region
from .tracks.reporting_rule import ReportingRule, slowest_s
from .types import Detections, Estimates, Pose, Scan, SelfReports

# Reason for which reports of moving radars are dropped: the radar's pose is unknown.
POSE_MISSING = "pose_missing"
# Anomaly: a report, or a slice of a revolution, is late, and its closed scan is reprocessed.
REPROCESSED = "late_reworked"


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan."""

    scan: Scan
    step: Step
    # Number of consecutive scans with detections but no targets if a warning is due; otherwise 0.
    scans_without_targets: int = 0


@dataclass(frozen=True)
class RunEnded:
    """The stamps jumped, or the run was flushed; later events belong to a new run."""

    reset: Reset | None  # The jump; None if the run was flushed
    smoothed: tuple[Estimates, ...]  # Pending smoothed estimates, oldest first


Event: TypeAlias = "Stepped | RunEnded"


class Drops(NamedTuple):
    """What is dropped while it waits for poses or for the stamps of other radars, by reason."""

    reports: Counter[str]  # Numbers of reports, or of slices of a revolution
    detections: Counter[str]  # Numbers of their detections
    # How far the radar's stamps are ahead of those of others, seconds; see `Clocks.offset_s`.
    clock_offset_s: float | None = None

    def add(self, reason: str, detections: int) -> None:
        """Count a report that is dropped."""
        self.reports[reason] += 1
        self.detections[reason] += detections


@dataclass
class SensorStages:
    """The stages that the reports of one sensor pass before they join those of others in scans."""

    check: ReportCheck
    # Cuts the reports of a turning radar into slices. An out-of-sequence report changes the slices
    # of its revolution, which is then cut again.
    history: RevolutionHistory
    platform: Platform | None  # None for a fixed sensor
    twins: TwinCheck = field(default_factory=TwinCheck)
    drops: Drops = field(default_factory=lambda: Drops(Counter(), Counter()))


def start_cold(engine: Engine, stamp_ns: int) -> None:
    """Leave the engine as it is at the start of a run; see `Pipeline`."""


class Pipeline:
    """Groups reports into scans and steps the engine through them.

    Its methods return iterators: a scan is stepped when its event is requested, so that its
    estimates can be published before the next scan is stepped. Every iterator must be exhausted
    before the next call.

    `begin` is called with the engine and the stamp of a run's first scan before that scan is
    stepped; it may restore the engine. `sensors` are in the configured order, and `out_of_sequence`
    steps the same engine. `configured` are the configured model and rule. The engine uses a copy of
    them with the estimated rotation periods of the antennas. `on_filtered` gets the filtered
    estimates of each step before the smoothing, which takes about as long as the filter; the step's
    event has them too.
    """

    def __init__(
        self,
        clocks: Clocks[SentReport],
        grouper: ScanGrouper,
        engine: Engine,
        begin: Callable[[Engine, int], None],
        *,
        sensors: Sequence[SensorStages],
        results: ResultCheck,
        out_of_sequence: OutOfSequence,
        region: Region | None,
        configured: tuple[TrackerModel, ReportingRule],
        on_filtered: OnFiltered = ignore_filtered,
    ) -> None:
        self.engine = engine
        self._sensors, self._results = sensors, results
        self._revolutions = [sensor.history.revolutions for sensor in sensors]
        self._clocks, self._grouper, self._out_of_sequence = clocks, grouper, out_of_sequence
        self._region, self._configured = region, configured
        self._posed = PosedReports([sensor.platform for sensor in sensors])
        self._reports = WaitingReports(configured[0].receivers)
        self._begin, self._on_filtered = begin, on_filtered
        self.manual = Manual()
        self.stamp_ns = 0  # Stamp of the latest scan
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
        self,
        radar: int,
        stamp_ns: int,
        detections: Detections,
        sector: int | None = None,
        received_ns: int | None = None,
    ) -> Iterator[Event] | Rejection:
        """Add one report; return the events of the scans that it closes.

        If no part of the report is used in any scan, the reason is returned. `radar` is the index
        in the configured order, `sector` the sector's number, if the report contains it, and
        `received_ns` the time of receipt, if it is known. A report whose stamp is far from those of
        other radars is held back; see `Clocks`. A copy of the radar's previous report under a later
        stamp is counted, and otherwise ignored: its errors are the same, so that as a look of its
        own it would count them twice.
        """
        sent = SentReport(radar, stamp_ns, detections, sector)
        due = self._clocks.add(sent, received_ns)
        self._drop_left_out()
        return self._add(sent) if len(due) == 1 else self._add_held(due)

    def _drop_left_out(self) -> None:
        """Count the reports that are left out because of their radar's clock."""
        for sent in self._clocks.take_left_out():
            self._sensors[sent.sensor].drops.add(CLOCK, len(sent.detections))

    def _add_held(self, due: Sequence[SentReport]) -> Iterator[Event]:
        """Yield the events of reports that were held back."""
        for sent in due:
            events = self._add(sent)
            if isinstance(events, Rejection):
                self._sensors[sent.sensor].drops.add(events.value, len(sent.detections))
            else:
                yield from events

    def add_reports(self, receiver: int, reports: SelfReports) -> Iterator[Event]:
        """Add self-reports, which wait for the scan after their times.

        `receiver` is the index among the configured receivers. Reports that come after that scan
        are used with the next one, as what they are: late. Without any radar they close the scans:
        one for each interval that they have passed, whose events are returned.
        """
        self._reports.add(receiver, reports)
        return self._pass_time(round(self._configured[0].modes.interval_s * 1e9))

    def _pass_time(self, interval_ns: int) -> Iterator[Event]:
        """Step a tracker of self-reports alone to the time that they have passed."""
        stamp_ns = None if self._sensors else self._reports.passed_ns(interval_ns)
        return self._events(() if stamp_ns is None else self._grouper.add_time(stamp_ns))

    def take_unused_reports(self) -> Counter[str]:
        """Return the numbers of self-reports that were not used since the last call, by reason."""
        return self._reports.take_dropped()

    def clock_offset_s(self, radar: int) -> float | None:
        """Return how far a radar's stamps are ahead of those of others; see `Clocks.offset_s`."""
        return self._clocks.offset_s(radar)

    def _add(self, sent: SentReport) -> Iterator[Event] | Rejection:
        """Add a report whose stamp is right; see `add`."""
        radar, stamp_ns, detections, sector = sent
        sensor, revolutions = self._sensors[radar], self._revolutions[radar]
        noticed = sensor.check.add(detections)
        for finding in noticed:
            # Sectors need no configuration once the rotation period is known.
            if finding != NO_SECTORS or not revolutions.period_s:
                revolutions.anomalies[finding] += 1
        if REPEATED in noticed and not revolutions.is_behind(stamp_ns):
            self._grouper.note_live(radar)
            return self._events([])
        if CONSTANT in noticed:
            detections = sensor.check.used(detections)
        revolutions.anomalies[TWINS] += sensor.twins.add(
            detections, self._configured[0].radars[radar]
        )
        nominal_s = revolutions.nominal_period_s
        can_recut = sensor.history.kept and self._out_of_sequence.since_ns() is not None
        if can_recut and nominal_s and revolutions.is_behind(stamp_ns):
            slices = self._insert(radar, stamp_ns, detections, sector)
        else:
            slices = sensor.history.split(stamp_ns, detections, sector)
        if revolutions.nominal_period_s != nominal_s:
            self._retune_to_rotation()
        if isinstance(slices, Rejection):
            return slices
        if detections.time_s is not None and not self._out_of_sequence.reprocesses:
            covered_s = revolutions.report_duration_s or revolutions.period_s
            self._grouper.covered_s[radar] = covered_s
        if self._posed.moving:
            self._posed.add(radar, slices)
            return self._events(self._group_released())
        closed: list[Scan | Reset] = []
        rejected = []
        for slice_ns, slice_detections in slices:
            grouped = self._group(radar, slice_ns, slice_detections)
            if isinstance(grouped, Rejection):
                rejected.append(grouped)
            else:
                closed += grouped
        if rejected and len(rejected) == len(slices):
            return rejected[0]
        revolutions.anomalies["slices_late"] += len(rejected)
        return self._events(closed)

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model and rule from the next scan on; their structure must be the same."""
        self._configured = model, rule
        self._retune_to_rotation()

    def _retune_to_rotation(self) -> None:
        """Adapt the engine's model and rule to the antennas' estimated rotation periods.

        A target may be unseen for as many revolutions of the slowest antenna as configured.
        """
        model, rule = self._configured
        radars = tuple(
            replace(radar, rotation_s=revolutions.nominal_period_s or radar.rotation_s)
            for radar, revolutions in zip(model.radars, self._revolutions, strict=True)
        )
        adapted = replace(model, radars=radars)
        factor = slowest_s(adapted) / slowest_s(model)
        self.engine.retune(adapted, replace(rule, coasting_s=factor * rule.coasting_s))

    def period_s(self, radar: int) -> float:
        """Return the estimated rotation period of a radar, seconds; 0 if unknown."""
        return self._revolutions[radar].period_s

    def first_period_s(self, radar: int) -> float:
        """Return the first estimate of a period that is not configured, seconds; otherwise 0."""
        revolutions = self._revolutions[radar]
        return 0.0 if revolutions.configured_period_s else revolutions.state.first_period_s

    def _group(
        self, radar: int, stamp_ns: int, detections: Detections
    ) -> list[Scan | Reset] | Rejection:
        """Add a report, or a slice of one, to its scan; return the scans that this closes.

        If its scan is closed already, that scan is reprocessed with it, where the engine can.
        """
        detections = self._select_in_region(radar, detections)
        grouped = self._grouper.add(radar, stamp_ns, detections)
        if grouped is not Rejection.LATE:
            return grouped
        since_ns, closed_ns = self._out_of_sequence.since_ns(), self._grouper.closed_ns
        if since_ns is None or closed_ns is None or not since_ns < stamp_ns <= closed_ns:
            return Rejection.LATE
        if self._out_of_sequence.has_report(radar, stamp_ns):
            return Rejection.DUPLICATE
        if not self._out_of_sequence.spend(stamp_ns, 0):
            return Rejection.LATE_BURST
        self._out_of_sequence.insert(radar, (), [(stamp_ns, detections)])
        self._revolutions[radar].anomalies[REPROCESSED] += 1
        return []

    def _insert(
        self, radar: int, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Slice] | Rejection:
        """Cut the revolutions of a radar again with an out-of-sequence report inserted.

        No slice remains to be grouped: the list is empty.
        """
        revolutions, history = self._revolutions[radar], self._sensors[radar].history
        later = history.count_later(stamp_ns)
        if isinstance(later, Rejection):
            return later
        since_ns, closed_ns = self._out_of_sequence.since_ns(), self._grouper.closed_ns
        if since_ns is None or closed_ns is None or stamp_ns <= since_ns:
            return Rejection.LATE
        longest_ns = round((revolutions.report_duration_s or revolutions.period_s) * 1e9)
        if not self._out_of_sequence.spend(stamp_ns - longest_ns, later):
            return Rejection.LATE_BURST
        recut = history.insert(stamp_ns, detections, sector)
        self._replace(radar, recut, since_ns, closed_ns)
        revolutions.anomalies[REPROCESSED] += 1
        return []

    def _replace(self, radar: int, recut: Recut, since_ns: int, closed_ns: int) -> None:
        """Replace the slices that were cut without an out-of-sequence report by the recut ones."""
        slices = [
            (stamp_ns, self._select_in_region(radar, each)) for stamp_ns, each in recut.slices
        ]
        self._grouper.replace(radar, recut.stamps_ns, slices)
        closed = [each for each in slices if since_ns < each[0] <= closed_ns]
        self._revolutions[radar].anomalies["slices_late"] += sum(
            each[0] <= since_ns for each in slices
        )
        self._out_of_sequence.insert(radar, recut.stamps_ns, closed)

    def _select_in_region(self, radar: int, detections: Detections) -> Detections:
        """Return the detections of a radar within the region."""
        if self._region is None:
            return detections
        return self._region.select_detections(detections, self._configured[0].radars[radar])

    def add_pose(self, radar: int, stamp_ns: int | None, pose: Pose) -> Iterator[Event] | PoseFault:
        """Add a pose of the platform of a moving radar, given its index in the configured order.

        With the stamp None it holds at all times.

        Return the events of the scans that waited for the pose, or why it is rejected.
        """
        fault = self._posed.add_pose(radar, stamp_ns, pose)
        return fault if fault is not None else self._events(self._group_released())

    def own_pose(self, stamp_ns: int) -> Pose | None:
        """Return own ship's pose at a stamp: the first sensor's place with its platform's heading.

        It is the first of the sensors that move, or without one the first of all, at rest and
        without a heading. None if it is unknown; see `Platform.own_pose`.
        """
        platforms = (sensor.platform for sensor in self._sensors)
        platform = next((each for each in platforms if each is not None), None)
        if platform is None:
            return Pose(self._configured[0].radars[0].position, math.nan)
        return platform.own_pose(stamp_ns)

    def own_ship(self, stamp_ns: int) -> Pose | None:
        """Return the pose of own ship at a stamp, as `own_pose`; None if no sensor moves."""
        return self.own_pose(stamp_ns) if self._posed.moving else None

    def operate(self, command: Command) -> str:
        """Do manual work, between two scans; return what was done in words.

        Raise `ValueError` for what cannot be done.
        """
        if command.verb != START:
            return self.manual.apply(command, self.engine.track_count)
        x, y, vx, vy = command.motion
        self.engine.start_track((x, y), (vx, vy))
        return f"a track begins at {x:.0f}, {y:.0f} m with the next scan"

    def take_drops(self) -> list[tuple[int, Drops]]:
        """Return what was dropped after `add` since the last call, with each radar's index."""
        taken = []
        for radar, sensor in enumerate(self._sensors):
            if sensor.drops.reports:
                offset_s = self._clocks.offset_s(radar)
                taken.append((radar, sensor.drops._replace(clock_offset_s=offset_s)))
                sensor.drops = Drops(Counter(), Counter())
        return taken

    def _group_released(self, everything: bool = False) -> Iterator[Scan | Reset]:
        """Yield the scans closed by reports that no longer wait for poses, or by all reports.

        A report is grouped after the scans that the reports before it close have been stepped: it
        may be out of sequence to these.
        """
        for report in self._posed.release(everything):
            if report.detections is None:
                self._sensors[report.radar].drops.add(POSE_MISSING, report.size)
                continue
            if report.extrapolated:
                self._revolutions[report.radar].anomalies["poses_extrapolated"] += 1
            grouped = self._group(report.radar, report.stamp_ns, report.detections)
            if isinstance(grouped, Rejection):
                self._sensors[report.radar].drops.add(grouped.value, report.size)
            else:
                yield from grouped

    def take_anomalies(self, radar: int) -> Counter[str]:
        """Return the counts of a radar's input anomalies since the last call."""
        anomalies = self._revolutions[radar].anomalies
        taken = +anomalies
        anomalies.clear()
        return taken

    def close_scans(self) -> Iterator[Event]:
        """Close all scans, complete or not, and step the engine through them."""
        yield from self._events(self._group_released(everything=True))
        yield from self._events(self._grouper.close_all())
        yield from self._pass_time(1)

    def flush(self) -> Iterator[Event]:
        """Close all scans, step the engine through them, and end the run."""
        yield from self.close_scans()
        self._forget_stamps()
        yield self._end(None)

    def reset(self) -> None:
        """Discard all scans, and return the engine to its initial state but for track numbers."""
        self._forget_stamps()
        self._reports.clear()
        self._out_of_sequence.forget()
        self.engine.flush()
        self._begun = False

    def _forget_stamps(self) -> None:
        self._clocks.reset()
        self._drop_left_out()
        self._grouper.reset()
        self._posed.forget()
        for sensor in self._sensors:
            sensor.history.revolutions.reset()
            sensor.history.clear()

    def _events(self, closed: Iterable[Scan | Reset]) -> Iterator[Event]:
        for event in closed:
            if isinstance(event, Reset):
                yield self._end(event)
                continue
            if not self._begun:
                self._begin(self.engine, event.stamp_ns)
                self._begun = True
            reports = self._reports.take(event.stamp_ns)
            scan = event if reports is None else replace(event, self_reports=reports)
            step = self._as_reported(self._out_of_sequence.step(scan, self._pass_on))
            since_ns = self._out_of_sequence.since_ns()
            for sensor in self._sensors:
                sensor.history.forget_before(event.stamp_ns if since_ns is None else since_ns)
            self.stamp_ns = event.stamp_ns
            targets_overdue = self._results.note_step(event, step)
            yield Stepped(event, step, self._results.scans if targets_overdue else 0)

    def _pass_on(self, filtered: tuple[Estimates, ...]) -> None:
        """Pass the filtered estimates that are reported to `on_filtered`."""
        self._on_filtered(self._select_reported(filtered))

    def _as_reported(self, step: Step) -> Step:
        """Return a step with only the estimates that are reported."""
        filtered = self._select_reported(step.filtered)
        smoothed = self._select_reported(step.smoothed)
        return Step(filtered, smoothed, step.class_mass, step.figures)

    def _select_reported(self, estimates: tuple[Estimates, ...]) -> tuple[Estimates, ...]:
        """Return estimates within the region, without tracks that an operator has dropped."""
        within = estimates if self._region is None else self._region.select_estimates(estimates)
        return self.manual.select(within) if self.manual.dropped else within

    def _end(self, reset: Reset | None) -> RunEnded:
        """End the run; after a jump ahead, known aircraft keep their track numbers."""
        ahead = reset is not None and reset.ahead
        due = self._out_of_sequence.finish()
        estimates = self.engine.interrupt() if ahead else self.engine.flush()
        self._out_of_sequence.forget()
        self._begun = False
        return RunEnded(reset, self._select_reported((*due, *estimates)))
