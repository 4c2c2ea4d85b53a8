"""The health of the tracker's inputs, steps, outputs and registration, as diagnostics."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.encoding import names
from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MeanResidual
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.types import Estimates, Reported
from phd_jdtc_ros.core.types.reports import ALARM, LEFT, SHARED
from phd_jdtc_ros.quoting import counts_text

from ..common.health import WARNING_MEMORY_S, Condition, Rhythm, Rises, first, status_of
from ..common.topics import SequenceNumbers
from .senders import Link

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE
# An input is silent after this number of its usual intervals and the slack. Two checks, up to
# 0.2 s, and the transport of the message add to this: silence is reported within half a second.
SILENT_AFTER_SCANS, SILENCE_SLACK_S = 2.0, 0.25
# A killed publisher stays in the graph for the middleware's lease, by default at most 20 s. Two
# that are listed together for longer than this must both be alive.
LEASE_S = 30.0


@dataclass(frozen=True)
class Publishers:
    """The publishers that the graph lists on a topic; a killed publisher is listed for a while."""

    identities: frozenset[Hashable]  # One identifier per publisher
    # One reason per publisher whose QoS prevents receiving from it.
    incompatible: tuple[str, ...] = ()
    hint: str = ""  # Why no publisher on the topic has the expected type; empty if one has it


@dataclass
class InputHealth:
    """A radar's reports, or a platform's poses, since the tracker was configured."""

    name: str
    topic: str  # Its full name, after remapping
    rhythm: Rhythm  # Intervals between its usable messages, by the wall clock
    shared: bool = False  # Whether several publishers are usual, as with transforms
    broken: str = ""  # Where the chain of transforms is broken; empty if it is not
    holds: bool = False  # Whether its last message holds until the next, however late that is
    received: int = 0
    detections: int = 0  # Of its reports, dropped ones included
    deadlines_missed: int = 0
    incompatible_qos: int = 0
    # Estimated time of a revolution that is not configured, seconds; 0 if there is none.
    revolution_found_s: float = 0.0
    anomalies: Counter[str] = field(default_factory=Counter)
    # Detections or messages that were not used, by reason.
    dropped: Counter[str] = field(default_factory=Counter)
    # How far its stamps are ahead of those of other radars, seconds; None if they agree.
    clock_offset_s: float | None = None
    fit: Fit | None = None  # The radar's innovations compared with its noise, if known
    # The learned values of the radar, see `anomalies.figures_of`.
    learned: Mapping[str, float] = field(default_factory=dict)
    _last_s: float | None = None
    _worked_s: float = 0.0
    _lost: int = 0
    _lost_by_overload: int = 0
    _numbering: SequenceNumbers = field(default_factory=SequenceNumbers)
    _listed_since_s: dict[Hashable, float] = field(default_factory=dict)
    # Faults of single detections and clouds by kind, the latest text of each, and the share of the
    # kinds that are many.
    _single: Counter[str] = field(default_factory=Counter)
    _texts: dict[str, str] = field(default_factory=dict)
    _many: dict[str, float] = field(default_factory=dict)
    _minute: Rises = field(default_factory=lambda: Rises(60.0))
    _dropped_detections: Counter[str] = field(default_factory=Counter)
    _warnings: int = 0
    _warning: str = ""
    _was_worse: bool = False
    _rises: Rises = field(default_factory=Rises)

    def note_message(self, now_s: float, sequence: int | None, worked_s: float) -> None:
        """Count a message and those lost before it, by its publisher's number for it."""
        # The tracker has worked for `worked_s` up to `now_s`.
        self.received += 1
        if sequence is not None and not self.shared:
            before = self.gaps
            self._numbering.add(sequence)
            if self.gaps > before and self._last_s is not None:
                share = (worked_s - self._worked_s) / max(now_s - self._last_s, 1e-9)
                self._lost += self.gaps - before
                # If more than this share of the time since a radar's previous message was spent on
                # work, a loss is the tracker's own: its queue overflows meanwhile. A loss in
                # transit is equally likely at any time.
                self._lost_by_overload += (self.gaps - before) * (share > 0.5)
        self._last_s, self._worked_s = now_s, worked_s

    def begin_series(self) -> None:
        """Let the next message begin a new series: none before it counts as lost or late."""
        self._numbering.begin_series()
        self.rhythm.begin_series()
        self._last_s = None

    @property
    def gaps(self) -> int:
        """Number of lost messages, as far as messages are numbered."""
        return self._numbering.lost

    def warn(self, text: str) -> None:
        """Warn for a while of input that is used but contradicts its configuration."""
        self._warnings, self._warning = self._warnings + 1, text

    def note_single(self, what: str, count: int, text: str, now_s: float) -> bool:
        """Count faults of single detections, or clouds; return whether such faults are many.

        The text begins with the count.
        """
        self._single[what] += count
        self._texts[what] = text.partition(" ")[2]
        return what in self._shares(now_s)

    def note_dropped(self, reason: str, count: int, text: str, now_s: float) -> bool:
        """Count detections that are not used; see `note_single`."""
        self.dropped[reason] += count
        self._dropped_detections[reason] += count
        return self.note_single(f"dropped_{reason}", count, text, now_s)

    def _shares(self, now_s: float) -> Mapping[str, float]:
        """Return the kinds of single faults that are many, each with its recent share.

        They are many from more than a normal share of all in the last minute on, and until they are
        less than a part of it.
        """
        # Of fewer than so many one fault is no share.
        fewest, recovered = 40, 0.4
        clouds = self._minute.recent("clouds", self.received, now_s)
        detections = self._minute.recent("detections", self.detections, now_s)
        many = {}
        for what, total in self._single.items():
            offered = max(clouds if what in anomalies.OF_CLOUDS else detections, fewest)
            share = self._minute.recent(what, total, now_s) / offered
            normal = anomalies.NORMAL.get(what, anomalies.MANY)
            if share > (recovered * normal if what in self._many else normal):
                many[what] = share
        self._many = anomalies.likely(many)
        return self._many

    def lost_by_overload(self, now_s: float) -> int:
        """Return the number of messages lost recently because the tracker is too slow."""
        return self._rises.recent("lost by overload", self._lost_by_overload, now_s)

    def silent(self, checked_s: float) -> bool:
        """Return whether nothing has arrived for `SILENT_AFTER_SCANS` of its usual intervals.

        All messages that had arrived by `checked_s` have been received. Messages that wait in the
        queue of a slow tracker must not count as silence.
        """
        if self.holds or self._last_s is None:
            return not self.holds
        limit_s = SILENT_AFTER_SCANS * self.rhythm.interval_s + SILENCE_SLACK_S
        return checked_s - self._last_s > limit_s

    def status(
        self, node: str, now_s: float, checked_s: float, publishers: Publishers
    ) -> DiagnosticStatus:
        """Return the input's status; `checked_s` is as in `silent`."""
        self._listed_since_s = {
            identity: self._listed_since_s.get(identity, now_s)
            for identity in publishers.identities
        }
        values: dict[str, object] = {"topic": self.topic, "received": self.received}
        if self._last_s is not None:
            values |= {"age_s": now_s - self._last_s, "interval_s": self.rhythm.interval_s}
        values |= {
            "gaps": self.gaps,
            "deadlines_missed": self.deadlines_missed,
            "incompatible_qos": self.incompatible_qos,
            "publishers": len(publishers.identities),
            **{f"dropped_{reason}": count for reason, count in sorted(self.dropped.items())},
            **dict(sorted(self.anomalies.items())),
        }
        if self.revolution_found_s:
            values["revolution_found_ms"] = round(1e3 * self.revolution_found_s)
        if self.clock_offset_s is not None:
            values["clock_offset_s"] = self.clock_offset_s
        if self.fit is not None and self.fit.innovations:
            axes = zip(self.fit.components, self.fit.axes.tolist(), strict=True)
            values |= {f"{component}_innovation": ratio for component, ratio in axes}
        values |= self.learned
        condition = self._condition(now_s, self.silent(checked_s), publishers)
        return status_of(node, self.name, condition, values, names.hardware(self.name, node))

    def _condition(self, now_s: float, silent: bool, publishers: Publishers) -> Condition:
        """Return the worst condition; silence is STALE and no ERROR, because tracking goes on."""
        listed, several = len(publishers.identities), ""
        if listed > 1 and not self.shared:
            several = (
                f"{listed} publishers listed on {self.topic}, must be one; a killed one disappears "
                "by itself"
            )
        age = "nothing received yet"
        if self._last_s is not None:
            age = f"silent for {now_s - self._last_s:.1f} s"
        silence = "; ".join(filter(None, (age, several, publishers.hint)))
        incompatible = f"incompatible QoS on {self.topic}: {'; '.join(publishers.incompatible)}"
        shared = self._has_several_publishers(now_s, silent)
        warned = self._rises.recent("warnings", self._warnings, now_s)
        rejected = self.dropped - self._dropped_detections
        dropped = self._rises.recent("dropped", rejected.total(), now_s)
        late = self._rises.recent("deadlines", self.deadlines_missed, now_s)
        single = [
            f"{100.0 * share:.0f} % in the last minute: {self._texts[what]}"
            for what, share in self._shares(now_s).items()
        ]
        lost, where = self._rises.recent("lost", self._lost, now_s), "on the way to the tracker"
        if self.lost_by_overload(now_s):
            where = "the tracker is too slow, see its step time"
        noise = None if self.fit is None else anomalies.of_noise(self.fit)
        worse = anomalies.of_learned(self.learned, self._was_worse)
        self._was_worse = worse is not None
        changed = anomalies.of_changes(self.learned)
        return first(
            (ERROR, shared, f"several publishers on {self.topic}, must be one"),
            (ERROR, publishers.incompatible, incompatible),
            (ERROR, publishers.identities and publishers.hint, publishers.hint),
            (ERROR, self.broken, self.broken),
            (STALE, silent, silence),
            (ERROR, self.clock_offset_s is not None, anomalies.clock_off(self.clock_offset_s)),
            (WARN, several, several),
            (WARN, warned, self._warning),
            (WARN, single, "; ".join(single)),
            (WARN, lost, f"{lost} messages lost in the last {WARNING_MEMORY_S:g} s: {where}"),
            (WARN, dropped, f"messages dropped: {counts_text(rejected)}"),
            (WARN, late, "a deadline was missed"),
            (WARN, noise, noise or ""),
            (WARN, changed, changed or ""),
            (WARN, worse, worse or ""),
            (OK, True, "receiving"),
        )

    def _has_several_publishers(self, now_s: float, silent: bool) -> bool:
        """Return whether several publishers are alive, by their numbers or by the graph."""
        if self.shared:
            return False
        if self._numbering.several and not silent:
            return True
        return sum(now_s - since_s > LEASE_S for since_s in self._listed_since_s.values()) > 1


class Load:
    """The time that the tracker has worked by the wall clock, in total and in a latest window."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._spans: deque[tuple[float, float]] = deque()
        self.worked_s = 0.0

    def add(self, begin_s: float, end_s: float) -> None:
        """Record work that has just ended."""
        self.worked_s += end_s - begin_s
        self._spans.append((begin_s, end_s))
        self._trim(end_s)

    def share(self, now_s: float) -> float:
        """Return the share of the window up to now in which the tracker worked, 0 to 1."""
        self._trim(now_s)
        since = now_s - self._window_s
        return sum(end - max(begin, since) for begin, end in self._spans) / self._window_s

    def _trim(self, now_s: float) -> None:
        while self._spans and self._spans[0][1] <= now_s - self._window_s:
            self._spans.popleft()


@dataclass
class StepHealth:
    """The tracker's own step time, and whether it keeps up."""

    # Figures of a step whose sums are in the diagnostics, if the engine has them.
    SUMMED = ("approximate_clusters", "floored_covariances")

    rhythm: Rhythm  # Intervals of the scans, by their stamps
    pace: Rhythm  # Intervals of the steps, by the wall clock
    engine: str = "gaussian"
    step_ms: float | None = None
    scans: int = 0
    run: int = 0
    closed_by_wait: int = 0
    scans_without_targets: int = 0
    sums: Counter[str] = field(default_factory=Counter)
    _targets_seen: bool = False

    def note_step(
        self,
        stamp_ns: int,
        now_s: float,
        step_ms: float,
        targets: int = 0,
        figures: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Record a step of `step_ms` of CPU time that reported `targets`; `figures` are by name."""
        self.scans += 1
        self.sums.update({name: int(figures[name]) for name in self.SUMMED if name in figures})
        if targets:
            self._targets_seen, self.scans_without_targets = True, 0
        self.rhythm.beat(stamp_ns * 1e-9)
        self.pace.beat(now_s)
        self.step_ms = step_ms

    def begin_series(self) -> None:
        """Let the next step begin a new series."""
        self.rhythm.begin_series()
        self.pace.begin_series()

    def status(self, node: str, lost: int, busy: float) -> DiagnosticStatus:
        """Return the status of the step time.

        Losses come first, because the interval between the scans that were received is not that
        of the scans that were sent.

        `lost` messages of all radars were lost recently because the tracker is too slow, and `busy`
        is the share of the recent time in which it worked.
        """
        # The tracker is at its limit if it works for more than this share of the time while scans
        # are stepped at about the rate of their stamps. A replay that waits for the tracker keeps
        # it as busy, but at a much higher rate.
        busy_share, real_time = 0.95, 0.9
        of_particles = "turn down accuracy, particles or lag"
        advice = {
            **dict.fromkeys(("phd", "phd_as_printed"), of_particles),
            "phd_gaussian": "turn down lag",
        }.get(self.engine, "turn down accuracy or lag")
        interval_s = self.rhythm.interval_s
        lost_text = f"overloaded, {lost} messages lost in the last {WARNING_MEMORY_S:g} s: {advice}"
        slow = self.step_ms is not None and self.step_ms > 1e3 * interval_s
        at_limit = busy > busy_share and self.pace.interval_s > real_time * interval_s
        busy_text = f"at its limit, busy for {busy:.0%} of the time: {advice}"
        # Once there were targets, their absence is not suspicious.
        missing = self.scans_without_targets and not self._targets_seen
        condition = first(
            (STALE, self.step_ms is None, "no scan yet"),
            (WARN, lost, lost_text),
            (WARN, slow, f"too slow for the scan interval: {advice}"),
            (WARN, at_limit, busy_text),
            (WARN, missing, anomalies.no_targets(self.scans_without_targets)),
            (OK, True, "in time"),
        )
        values = {
            **({} if self.step_ms is None else {"step_ms": self.step_ms}),
            "scan_interval_ms": 1e3 * interval_s,
            "busy": busy,
            "scans": self.scans,
            "run": self.run,
            "closed_by_wait": self.closed_by_wait,
            **self.sums,
        }
        if self.scans_without_targets:
            values["scans_without_targets"] = self.scans_without_targets
        return status_of(node, "step time", condition, values)


@dataclass
class OutputHealth:
    """Numbers of subscriptions to the tracker's outputs that request incompatible QoS, by topic."""

    refused: Counter[str] = field(default_factory=Counter)
    _rises: Rises = field(default_factory=Rises)

    def status(
        self, node: str, now_s: float, unsaved: str = "", links: Sequence[Link] = ()
    ) -> DiagnosticStatus:
        """Return the status of the outputs; `node` is the full name of the tracker.

        `unsaved` is the reason why the last checkpoint was not written; empty if it was. `links`
        are those to destinations by UDP and TCP.
        """
        refused = self._rises.recent("refused", self.refused.total(), now_s)
        stalled = self._rises.recent("stalled", sum(link.stalled for link in links), now_s)
        fault = next((link.fault for link in links if link.fault), "")
        condition = first(
            (ERROR, unsaved, unsaved),
            (WARN, refused, "a subscription asks for incompatible QoS"),
            (WARN, fault, fault),
            (WARN, stalled, "a receiver that did not read was disconnected"),
            (OK, True, "served"),
        )
        values = {f"incompatible_qos {topic}": n for topic, n in sorted(self.refused.items())}
        for link in links:
            values[f"{link.where} receivers"] = link.receivers
            values[f"{link.where} sent"] = link.sent
            values[f"{link.where} stalled"] = link.stalled
        return status_of(node, "outputs", condition, values)


def conflict_status(watch: Watch, node: str) -> DiagnosticStatus:
    """Return the alarms of conflicts, which are no fault; `node` is the tracker's full name."""
    found, fresh = watch.latest, watch.alarms.fresh
    values = {
        "conflicts": 0 if found is None else len(found),
        "alarms": 0 if found is None else int((found.alarm > 0).sum()),
        "not_acknowledged": fresh,
        "threshold": watch.alarms.threshold,
    }
    text = f"{fresh} alarms are not acknowledged" if fresh else "no alarm to acknowledge"
    return status_of(node, "conflicts", Condition(OK, text), values)


def reports_status(found: Estimates, node: str) -> DiagnosticStatus:
    """Return what self-reports say of the latest estimates, which is no fault of the tracker.

    The values are numbers of tracks, and a sentence for each dark target, doubtful source, shared
    address and track that its source has left; `node` is the tracker's full name.
    """
    told = found.reports or Reported.unknown(len(found))
    dark, doubtful = (np.nan_to_num(each) > ALARM for each in (told.dark, told.doubtful))
    left, shared = (told.reason == LEFT) & (told.alone == 0), told.reason == SHARED
    values: dict[str, object] = {
        "reporting": int(((told.owned > 0.5) & (told.alone == 0)).sum()),
        "dark": int(dark.sum()),
        "doubtful": int(doubtful.sum()),
        "left": int(left.sum()),
        "shared": int(shared.sum()),
        "alone": int(told.alone.sum()),
    }
    # Largest number of findings that are told in words.
    for row in np.flatnonzero(dark | doubtful | left | shared)[:10].tolist():
        values[f"track_{found.track_id[row]}"] = told.reason_text(row, found.stamp_ns)
    text = ", ".join(f"{count} {name}" for name, count in values.items() if isinstance(count, int))
    return status_of(node, "self-reports", Condition(OK, text), values)


def registration_status(found: MeanResidual, node: str) -> DiagnosticStatus:
    """Return the status of a radar's agreement with the others; `node` is the tracker's name."""
    values: dict[str, object] = {"residuals": found.residuals}
    if found.residuals:
        values |= {
            "range_residual_m": float(found.mean[0]),
            "range_sigma_m": float(found.sigma[0]),
            "azimuth_residual_deg": math.degrees(found.mean[1]),
            "azimuth_sigma_deg": math.degrees(found.sigma[1]),
        }
    few = f"{found.residuals} detections of tracks that other radars see too, judged from {LEAST}"
    biased = anomalies.of_registration(found)
    condition = first(
        (WARN, biased, f"{biased}; record a bag and run register"),
        (OK, found.residuals < LEAST, few),
        (OK, True, "agrees with the other radars"),
    )
    line, hardware_id = f"registration of {found.radar}", names.hardware(found.radar, node)
    return status_of(node, line, condition, values, hardware_id)
