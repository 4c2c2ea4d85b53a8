"""Feeds the core's pipeline, for the live node, the offline tracker, the tables and the study.

::

    a message, its bytes or a row of a table
      |  decoded by the caller                   msg_adapters, api
    Report, or a pose
      |  pipeline; notices of unused input       Feed
    events: stepped scans, and ended runs

`Tally` counts the notices, for callers that report them at the end.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from msg_adapters.encoding import RejectedMessageError
from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.calibration.registration.monitor import MeanResidual
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.engine import Engine, OnFiltered, ignore_filtered
from phd_jdtc_ros.core.intake.clocks import CLOCK
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Rejection, Reset
from phd_jdtc_ros.core.pipeline import POSE_MISSING, Drops, Event, RunEnded, start_cold
from phd_jdtc_ros.core.types import Estimates, Scan
from phd_jdtc_ros.quoting import counts_text


class Notices(Protocol):
    """Receives notices of input that is not used or contradicts its configuration."""

    def on_unreadable(self, radar: int, error: RejectedMessageError) -> None:
        """Receive the fault of a message that is not a valid report."""

    def on_report(self, radar: int, report: Report) -> None:
        """Receive a report before it is used."""

    def on_rejection(self, radar: int, reason: str, report: Report) -> None:
        """Receive a report of which no part belongs to a scan."""

    def on_drops(self, radar: int, drops: Drops, why: str = "") -> None:
        """Receive what of a radar was dropped after it had been added, at least one report.

        `why` is the reason for a missing pose in words; empty if none is missing.
        """

    def on_anomalies(self, radar: int, counts: Counter[str]) -> None:
        """Receive the numbers of anomalies, at least one, by kind; see `anomalies`."""

    def on_revolution_period(self, radar: int, revolution_s: float) -> None:
        """Receive the estimated time of a revolution, seconds; 0 if it is configured or unknown."""

    def on_told(self, receiver: int, told: Told) -> None:
        """Receive a message of self-reports, given the index of its receiver."""

    def on_untold(self, receiver: int, error: RejectedMessageError) -> None:
        """Receive the fault of a message that has no valid self-reports."""

    def on_unused_reports(self, counts: Counter[str]) -> None:
        """Receive the numbers of self-reports that no scan used, at least one, by reason."""

    def on_unreadable_pose(self, topic: str, error: RejectedMessageError) -> None:
        """Receive the fault of a message that is not a valid pose."""

    def on_pose(self, topic: str, faults: Sequence[PoseFault]) -> None:
        """Receive the reasons for which some radars do not use a pose; empty if all use it."""


class Monitor(Protocol):
    """Watches the scans that are stepped."""

    def add_scan(self, scan: Scan, filtered: Sequence[Estimates]) -> None:
        """Receive a scan and its filtered estimates."""

    def forget_tracks(self) -> None:
        """Begin a new run."""


class Feed:
    """A tracker's pipeline with its input.

    Its methods return iterators of events, as the pipeline's do: every one must be exhausted
    before the next call. See `Pipeline` for `begin` and `on_filtered`. `why_missing` says in words
    why a radar has no pose.
    """

    def __init__(
        self,
        config: TrackerConfig,
        notices: Notices,
        monitors: Sequence[Monitor] = (),
        begin: Callable[[Engine, int], None] = start_cold,
        on_filtered: OnFiltered = ignore_filtered,
        why_missing: Callable[[int], str] = lambda radar: "",
    ) -> None:
        self.pipeline = new_pipeline(config, begin, on_filtered)
        # Radars whose reports may be found faulty after they were added: if a radar moves, all of
        # them, because the reports wait for poses in one queue.
        self._delayed = range(len(config.inputs) if config.radars_by_platform else 0)
        self._notices, self._monitors = notices, monitors
        self._why_missing = why_missing

    def message(
        self, radar: int, read: Callable[[], Report], received_ns: int | None = None
    ) -> Iterator[Event] | None:
        """Process a message, which `read` decodes; return None if no part of it is used.

        `received_ns` is the time of receipt by the clock that stamps should follow, if it is known.
        """
        try:
            report = read()
        except RejectedMessageError as error:
            self._notices.on_unreadable(radar, error)
            return None
        return self.report(radar, report, received_ns)

    def report(
        self, radar: int, report: Report, received_ns: int | None = None
    ) -> Iterator[Event] | None:
        """Process a report; see `message`."""
        self._notices.on_report(radar, report)
        events = self.pipeline.add(
            radar, report.stamp_ns, report.detections, report.sector, received_ns
        )
        if anomalies := report.anomalies + self.pipeline.take_anomalies(radar):
            self._notices.on_anomalies(radar, anomalies)
        self._notices.on_revolution_period(radar, self.pipeline.first_period_s(radar))
        if isinstance(events, Rejection):
            self._notices.on_rejection(radar, events.value, report)
            return None
        return self._monitor(events)

    def self_reports(self, receiver: int, read: Callable[[], Told]) -> Iterator[Event]:
        """Process a message of self-reports, which `read` decodes; they wait for the next scans."""
        try:
            told = read()
        except RejectedMessageError as error:
            self._notices.on_untold(receiver, error)
            return iter(())
        self._notices.on_told(receiver, told)
        return self._monitor(self.pipeline.add_reports(receiver, told.reports))

    def pose(
        self, topic: str, read: Callable[[], tuple[Sequence[RadarPose], Sequence[PoseFault]]]
    ) -> Iterator[Event] | None:
        """Process a message about platforms, which `read` decodes to poses and harmless faults.

        Return None if it is unreadable. The events are those of the reports that waited for it.
        """
        try:
            found, faults = read()
        except RejectedMessageError as error:
            self._notices.on_unreadable_pose(topic, error)
            return None
        return self.add_poses(topic, found, faults)

    def add_poses(
        self, topic: str, poses: Iterable[RadarPose], faults: Iterable[PoseFault] = ()
    ) -> Iterator[Event]:
        """Give poses to their radars, one after the other, each with its events."""
        found, used = [*faults], False
        for radar, stamp_ns, pose in poses:
            events = self.pipeline.add_pose(radar, stamp_ns, pose)
            if isinstance(events, PoseFault):
                found.append(events)
            else:
                used = True
                yield from self._monitor(events)
        if used or found:
            self._notices.on_pose(topic, found)

    def close_scans(self) -> Iterator[Event]:
        """Close all scans, complete or not."""
        return self._monitor(self.pipeline.close_scans())

    def flush(self) -> Iterator[Event]:
        """Close all scans, and end the run."""
        return self._monitor(self.pipeline.flush())

    def reset(self) -> None:
        """Discard all scans and begin a new run."""
        self.pipeline.reset()
        for monitor in self._monitors:
            monitor.forget_tracks()

    def _monitor(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield each event, and then show it to the monitors; at the end report the drops."""
        for event in events:
            yield event  # first, because estimates must not wait for the monitors
            for monitor in self._monitors:
                if isinstance(event, RunEnded):
                    monitor.forget_tracks()
                else:
                    monitor.add_scan(event.scan, event.step.filtered)
        if counts := self.pipeline.take_unused_reports():
            self._notices.on_unused_reports(counts)
        for radar, drops in self.pipeline.take_drops():
            why = self._why_missing(radar) if POSE_MISSING in drops.reports else ""
            self._notices.on_drops(radar, drops, why)
        for radar in self._delayed:
            if anomalies := self.pipeline.take_anomalies(radar):
                self._notices.on_anomalies(radar, anomalies)


class StepClock:
    """Measures this thread's CPU time of each step: decoding, tracking and output of a scan.

    The time within its ``with`` blocks counts. Work that steps no scan, such as a report that only
    completes a part of one, counts for the next step.
    """

    def __init__(self) -> None:
        self._cpu_s = self._begin_s = 0.0

    def __enter__(self) -> StepClock:
        self._begin_s = time.thread_time()
        return self

    def __exit__(self, *raised: object) -> None:
        self._cpu_s += time.thread_time() - self._begin_s

    def take_ms(self) -> float:
        """Return the CPU time since the last call, milliseconds; call it once for each step."""
        now_s = time.thread_time()
        taken_s = self._cpu_s + now_s - self._begin_s
        self._cpu_s, self._begin_s = 0.0, now_s
        return 1e3 * taken_s

    def discard(self) -> None:
        """Forget the time so far, because no step follows it."""
        self._cpu_s, self._begin_s = 0.0, time.thread_time()


# Largest number of reasons in a message, and the parameters to check for each reason.
MAX_LISTED = 3
PARAMETERS = {
    "amplitude": "amplitude_unit",
    "azimuth": "azimuth_unit",
    "frame": "frame",
    "height": "height, geodetic",
    "late": "reorder_s, late_reports",
    "late_burst": "reorder_s, late_reports",
    "not_finite": "fields",
    POSE_MISSING: "pose",
    "range": "min_range, max_range",
    "schema": "fields",
    "time": "time_unit, time_reference, rotation_s",
}


@dataclass
class DetectionCounts:
    """Counts all detections of a recording, and the unused ones by reason."""

    # All detections; an unreadable message counts as one, because its number is unknown.
    offered: int = 0
    lost: Counter[str] = field(default_factory=Counter)  # Unused detections by reason
    _unreadable: int = 0
    _details: dict[str, str] = field(default_factory=dict)  # Of the first message, by reason

    def unreadable(self, reason: str, detail: str) -> None:
        """Count a message that cannot be read."""
        self.offered += 1
        self.lost[reason] += 1
        self._unreadable += 1
        self.explain(reason, detail)

    def explain(self, reason: str, detail: str) -> None:
        """Keep what is wrong with the first message behind a reason."""
        self._details.setdefault(reason, detail)

    def read(self, kept: int, dropped: Mapping[str, int]) -> None:
        """Count a message's detections: the kept ones, and the dropped ones by reason."""
        self.offered += kept
        for reason, count in dropped.items():
            self.offered += count
            self.lost[reason] += count

    def unused(self, reasons: Mapping[str, int] | None = None) -> str:
        """Return the sentence about unused detections, with other counts if these are given."""
        listed = counts_text(self.lost if reasons is None else reasons)
        return f"{self.lost.total()} of {self.offered} detections were not used: {listed}"

    def fault(self) -> str | None:
        """Return an error message if too few detections were used, else None."""
        lost = min(self.lost.total(), self.offered)
        # Least share of used detections for a result that counts as a success.
        if self.offered - lost >= 0.5 * self.offered:
            return None
        listed = ", ".join(
            f"{reason} {count}{self._hint(reason)}"
            for reason, count in self.lost.most_common(MAX_LISTED)
        )
        what = "messages" if self._unreadable == self.offered else "detections"
        return (
            f"{self.offered - lost} of {self.offered} {what} could be used; "
            f"most frequent reasons: {listed}"
        )

    def _hint(self, reason: str) -> str:
        """Return what to check for a reason, and what is wrong with the first message."""
        known = PARAMETERS.get(reason), self._details.get(reason)
        hint = ": ".join(each for each in known if each)
        return f" ({hint})" if hint else ""


class Tally:
    """Counts the `Notices` of a whole run; `dropped` has all unused inputs by reason."""

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self.dropped: Counter[str] = Counter()
        self.detections = DetectionCounts()
        self._warned: list[Counter[str]] = [Counter() for _ in config.inputs]
        self._revolutions_s = [0.0] * len(config.inputs)
        self._without_amplitude: set[int] = set()
        self._silent = set(range(len(config.inputs)))  # Sensors without a message
        self._span_ns: dict[int, tuple[int, int]] = {}  # First and last stamp of each sensor
        # Receivers without a message; and the self-reports of all others, used and unused.
        self._deaf = set(range(len(config.receivers)))
        self.self_reports = DetectionCounts()
        self._targets_seen, self._overdue = False, 0
        self._figures: Mapping[str, float] = {}
        self._resets: list[Reset] = []
        # How far the stamps of sensors were ahead of those of others, seconds; see `Drops`.
        self._clocks_off: dict[int, float | None] = {}
        self._reparented = 0  # Number of messages after which a frame had another parent

    def on_unreadable(self, radar: int, error: RejectedMessageError) -> None:
        """Count a message that is not a valid report."""
        self._silent.discard(radar)
        self.dropped[error.reason] += 1
        name = self._config.inputs[radar].name
        self.detections.unreadable(error.reason, f"{name}: {error}")

    def on_report(self, radar: int, report: Report) -> None:
        """Count a report's detections, used and dropped."""
        self._silent.discard(radar)
        first_ns, last_ns = self._span_ns.get(radar, (report.stamp_ns, report.stamp_ns))
        self._span_ns[radar] = min(first_ns, report.stamp_ns), max(last_ns, report.stamp_ns)
        self.detections.read(len(report.detections), report.dropped)
        for reason, count in report.dropped.items():
            self.dropped[reason] += count
        if report.detections.amplitude is None and self._config.inputs[radar].measures_amplitude:
            self._without_amplitude.add(radar)

    def on_rejection(self, radar: int, reason: str, report: Report) -> None:
        """Count the detections of a report of which no part belongs to a scan."""
        self.dropped[reason] += 1
        self.detections.lost[reason] += len(report.detections)

    def on_drops(self, radar: int, drops: Drops, why: str = "") -> None:
        """Count the reports that were dropped while they waited."""
        self.dropped.update(drops.reports)
        if why:
            self.detections.explain(POSE_MISSING, why)
        self.detections.lost.update(drops.detections)
        if CLOCK in drops.reports:
            before_s, offset_s = self._clocks_off.get(radar), drops.clock_offset_s
            self._clocks_off[radar] = before_s if offset_s is None else offset_s

    def on_anomalies(self, radar: int, counts: Counter[str]) -> None:
        """Count contradictions of the configuration."""
        self._warned[radar].update(counts)

    def on_revolution_period(self, radar: int, revolution_s: float) -> None:
        """Keep the estimated time of a revolution, seconds."""
        self._revolutions_s[radar] = revolution_s

    def on_told(self, receiver: int, told: Told) -> None:
        """Count the self-reports of a message, used and dropped."""
        self._deaf.discard(receiver)
        self.self_reports.read(len(told.reports), told.dropped)

    def on_untold(self, receiver: int, error: RejectedMessageError) -> None:
        """Count a message without valid self-reports."""
        self._deaf.discard(receiver)
        name = self._config.receivers[receiver].name
        self.self_reports.unreadable(error.reason, f"{name}: {error}")

    def on_unused_reports(self, counts: Counter[str]) -> None:
        """Count self-reports that no scan used."""
        self.self_reports.lost.update(counts)

    def on_unreadable_pose(self, topic: str, error: RejectedMessageError) -> None:
        """Count a message that is not a valid pose."""
        self.dropped[f"pose_{error.reason}"] += 1
        self.detections.explain(POSE_MISSING, f"{topic}: {error}")

    def on_pose(self, topic: str, faults: Sequence[PoseFault]) -> None:
        """Count a pose that is not used, once for each cause; and changes of a frame's parent."""
        self._reparented += PoseFault.PARENT in faults
        unused = {fault.value for fault in faults} - {PoseFault.PARENT.value}
        self.dropped.update({f"pose_{reason}" for reason in unused})

    def note_event(self, event: Event) -> None:
        """Record whether targets were found, or that the stamps jumped."""
        if isinstance(event, RunEnded):
            self._resets += [] if event.reset is None else [event.reset]
            return
        self._targets_seen |= event.step.targets > 0
        self._overdue = event.scans_without_targets or self._overdue
        self._figures = event.step.figures

    @property
    def learned(self) -> dict[str, float]:
        """The learned values of the sensors, by dotted name; see `Factors.figures`."""
        return {name: value for name, value in self._figures.items() if "." in name}

    def about_radars(
        self, fits: Sequence[Fit] = (), residuals: Sequence[MeanResidual] = ()
    ) -> Iterator[tuple[int, str]]:
        """Yield each contradiction of the configuration once, with the radar's index.

        `fits` are the innovations of the radars, and `residuals` those against the tracks of other
        radars, if they are known.
        """
        for index, radar in enumerate(self._config.inputs):
            if index in self._without_amplitude and self._config.classifies_by_amplitude:
                yield index, anomalies.no_amplitude(radar)
            if self._revolutions_s[index]:
                yield index, anomalies.revolution_found(radar, self._revolutions_s[index])
            for text in anomalies.of(radar, self._warned[index]):
                yield index, text
            if index in self._clocks_off:
                yield index, anomalies.clock_off(self._clocks_off[index])
            elif not self._clocks_off and self._is_apart(index):
                yield index, anomalies.apart(*self._span_ns[index])
        for index, fit in enumerate(fits):
            own = anomalies.figures_of(fit.radar, self._figures)
            texts = anomalies.of_noise(fit), anomalies.of_learned(own), anomalies.of_changes(own)
            yield from ((index, text) for text in texts if text is not None)
        for index, found in enumerate(residuals):
            if biased := anomalies.of_registration(found):
                yield index, f"{biased}; check {found.radar}.position, yaw_deg and biases"

    def _is_apart(self, index: int) -> bool:
        """Return whether all stamps of a sensor are before or after those of the others."""
        others = [span_ns for other, span_ns in self._span_ns.items() if other != index]
        if not others or index not in self._span_ns:
            return False
        (first_ns, last_ns), (firsts_ns, lasts_ns) = self._span_ns[index], zip(*others, strict=True)
        return first_ns < last_ns and (last_ns < min(firsts_ns) or first_ns > max(lasts_ns))

    def silent(self) -> Iterator[SensorParameters]:
        """Yield the sensors that have sent nothing."""
        return (self._config.inputs[index] for index in sorted(self._silent))

    def fault(self) -> str | None:
        """Return an error message if nothing came, or too few detections were used, else None."""
        if len(self._silent) == len(self._config.inputs):
            topics = " or ".join(each.topic for each in self._config.inputs)
            return f"nothing to track, without a message on {topics}"
        if not self.detections.offered:
            return "nothing to track: no cloud has a detection"
        return self.detections.fault()

    def about_run(self) -> Iterator[str]:
        """Yield the warnings that stamps jumped, parents changed, and no target was ever reported.

        The last needs enough scans.
        """
        for index in sorted(self._deaf):
            yield f"{self._config.receivers[index].name}: silent, without self-reports"
        if self.self_reports.lost:
            yield self.self_reports.unused().replace("detections", "self-reports")
        if self._reparented:
            yield anomalies.reparented(self._reparented)
        if self._resets:
            largest = max(self._resets, key=lambda reset: abs(reset.jump_s))
            yield anomalies.started_again(largest, len(self._resets))
        if self._overdue and not self._targets_seen:
            yield anomalies.no_targets(self._overdue)

    def warnings(self, fits: Sequence[Fit]) -> Iterator[str]:
        """Yield all warnings of a run; `fits` are the innovations of the radars."""
        yield from (f"{each.topic}: silent, without a message" for each in self.silent())
        for index, text in self.about_radars(fits):
            yield f"{self._config.inputs[index].topic}: {text}"
        yield from self.about_run()
