"""Feeds the core's pipeline, for the live node, the offline tracker, the tables and the study.

::

    a message, its bytes or a row of a table
      |  decoded by the caller                   msg_adapters, api
    Report, or a pose
      |  pipeline; notices of unused input       Feed
    events: stepped scans, and ended runs

`tally` counts the notices, for callers that report them at the end.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

from msg_adapters.encoding import RejectedMessageError
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.engine import Engine, OnFiltered, ignore_filtered
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import POSE_MISSING, Drops, Event, RunEnded, start_cold
from phd_jdtc_ros.core.types import Estimates, Scan


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
        self._refused: dict[int, PoseFault] = {}  # Why the latest pose of a radar is not used

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
        if noticed := report.anomalies + self.pipeline.take_anomalies(radar):
            self._notices.on_anomalies(radar, noticed)
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
                self._refused[radar] = events
            else:
                used = True
                self._refused.pop(radar, None)
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
            yield event  # Estimates must not wait for the monitors.
            for monitor in self._monitors:
                if isinstance(event, RunEnded):
                    monitor.forget_tracks()
                else:
                    monitor.add_scan(event.scan, event.step.filtered)
        if counts := self.pipeline.take_unused_reports():
            self._notices.on_unused_reports(counts)
        for radar, drops in self.pipeline.take_drops():
            why = self._why_no_pose(radar) if POSE_MISSING in drops.reports else ""
            self._notices.on_drops(radar, drops, why)
        for radar in self._delayed:
            if noticed := self.pipeline.take_anomalies(radar):
                self._notices.on_anomalies(radar, noticed)

    def _why_no_pose(self, radar: int) -> str:
        fault = self._refused.get(radar)
        if fault is None:
            return self._why_missing(radar)
        return f"the latest pose is rejected: {anomalies.POSE_FAULTS[fault]}"


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
