"""The health of the tracker's steps, outputs and registration, as diagnostics."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.encoding import names
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MeanResidual
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.types import Estimates, Reported
from phd_jdtc_ros.core.types.reports import ALARM, LEFT

from ..common.health import WARNING_MEMORY_S, Condition, Rhythm, Rises, first, status_of
from .senders import Link

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
# The tracker is at its limit if it works for more than BUSY_SHARE of the time while scans are
# stepped at about the rate of their stamps. A replay that waits for the tracker keeps it as busy,
# but at a much higher rate.
BUSY_SHARE, REAL_TIME = 0.95, 0.9
# Advice for reducing the step time, and that for engines with parameters of their own.
LOAD_ADVICE = "turn down accuracy or lag"
OTHER_ADVICE = {
    **dict.fromkeys(("phd", "phd_as_printed"), "turn down accuracy, particles or lag"),
    "phd_gaussian": "turn down lag",
}
REGISTRATION_ADVICE = "record a bag and run register"


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
        advice = OTHER_ADVICE.get(self.engine, LOAD_ADVICE)
        interval_s = self.rhythm.interval_s
        lost_text = f"overloaded, {lost} messages lost in the last {WARNING_MEMORY_S:g} s: {advice}"
        slow = self.step_ms is not None and self.step_ms > 1e3 * interval_s
        at_limit = busy > BUSY_SHARE and self.pace.interval_s > REAL_TIME * interval_s
        busy_text = f"at its limit, busy for {busy:.0%} of the time: {advice}"
        # Once there were targets, their absence is not suspicious.
        missing = self.scans_without_targets and not self._targets_seen
        condition = first(
            (DiagnosticStatus.STALE, self.step_ms is None, "no scan yet"),
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
            (DiagnosticStatus.ERROR, unsaved, unsaved),
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

    The values are numbers of tracks, and a sentence for each dark target, doubtful source and track
    that its source has left; `node` is the tracker's full name.
    """
    told = found.reports or Reported.unknown(len(found))
    dark, doubtful = (np.nan_to_num(each) > ALARM for each in (told.dark, told.doubtful))
    left = (told.reason == LEFT) & (told.alone == 0)
    values: dict[str, object] = {
        "reporting": int(((told.owned > 0.5) & (told.alone == 0)).sum()),
        "dark": int(dark.sum()),
        "doubtful": int(doubtful.sum()),
        "left": int(left.sum()),
        "alone": int(told.alone.sum()),
    }
    # Largest number of findings that are told in words.
    for row in np.flatnonzero(dark | doubtful | left)[:10].tolist():
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
        (WARN, biased, f"{biased}; {REGISTRATION_ADVICE}"),
        (OK, found.residuals < LEAST, few),
        (OK, True, "agrees with the other radars"),
    )
    line, hardware_id = f"registration of {found.radar}", names.hardware(found.radar, node)
    return status_of(node, line, condition, values, hardware_id)
