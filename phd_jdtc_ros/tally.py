"""Counts what a whole run used and did not use, and says what contradicts its configuration.

`Tally` receives the `feed.Notices` of a recording, and gives warnings, and an error message if too
little was used.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from msg_adapters.encoding import RejectedMessageError
from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.calibration.registration.monitor import MeanResidual
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import PADDING, Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.intake.clocks import CLOCK
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Reset
from phd_jdtc_ros.core.pipeline import POSE_MISSING, Drops, Event, RunEnded
from phd_jdtc_ros.quoting import counts_text

# Largest number of reasons in a message, and the parameters to check for each reason.
MAX_LISTED = 3
PARAMETERS = {
    "amplitude": "units.amplitude",
    "azimuth": "units.azimuth",
    "frame": "frame",
    "height": "height, geodetic",
    "late": "reorder_s, late_reports",
    "late_burst": "reorder_s, late_reports",
    "not_finite": "fields",
    POSE_MISSING: "pose",
    "range": "min_range, max_range",
    "schema": "fields",
    "time": "units.time, units.time_reference, rotation_s",
}


@dataclass
class DetectionCounts:
    """Counts all detections of a recording, and the unused ones by reason."""

    # All detections; an unreadable message counts as one, because its number is unknown.
    offered: int = 0
    lost: Counter[str] = field(default_factory=Counter)  # Unused detections by reason
    _unreadable: int = 0
    _details: dict[str, str] = field(default_factory=dict)  # What is wrong, by reason

    def unreadable(self, reason: str, detail: str) -> None:
        """Count a message that cannot be read."""
        self.offered += 1
        self.lost[reason] += 1
        self._unreadable += 1
        self._details.setdefault(reason, detail)  # That of the first message

    def explain(self, reason: str, detail: str) -> None:
        """Keep what is wrong, until there is a later explanation of the reason."""
        self._details[reason] = detail

    def read(self, kept: int, dropped: Mapping[str, int]) -> None:
        """Count a message's detections: the kept ones, and the dropped ones by reason."""
        self.offered += kept
        for reason, count in dropped.items():
            if reason != PADDING:
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
        """Return what to check for a reason, and what is wrong."""
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
        self._pose_unreadable = False  # Whether a message about platforms could not be read
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
        if why and not self._pose_unreadable:
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
        if not self._pose_unreadable:
            self.detections.explain(POSE_MISSING, f"{topic}: {error}")
        self._pose_unreadable = True

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
            for text in anomalies.of(radar, anomalies.likely(self._warned[index])):
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
