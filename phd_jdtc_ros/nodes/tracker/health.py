"""The health of the tracker's inputs, steps and outputs, as diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, doubts, names
from phd_jdtc_ros.calibration.innovations import Fit

from ..common.health import WARNING_MEMORY_S, Lately, Rhythm
from ..common.sequence_numbers import SequenceNumbers

# Added to the scans that a radar may miss. Noticing it takes two looks, up to 0.2 s, and the
# message its way, so that a radar is reported silent within half a second after those scans.
SILENCE_SLACK_S = 0.25
# A killed publisher stays in the graph for the middleware's lease, by default at most 20 s. Two
# that are listed together for longer than this must both be alive.
LEASE_S = 30.0
# If more than this share of the time since a radar's previous message was spent on work, a loss is
# the tracker's own: its queue overflows meanwhile. A loss on the way is as likely at any time.
WORKING_SHARE = 0.5
# With less idle time than this leaves, and no more scans than in real time, the tracker is at its
# limit. A replay that waits for the tracker keeps it as busy, but with many scans a second.
BUSY_SHARE = 0.95
REAL_TIME = 0.9
# What to do about steps that take too long, by engine.
ADVICE = {
    "particles": "turn down accuracy, particles_per_target or lag",
    "gaussian": "turn down accuracy or lag",
}
# Figures of a step whose sum is part of the health, where an engine has them.
SUMMED = ("approximate_clusters", "floored_covariances")


@dataclass(frozen=True)
class Publishers:
    """The publishers on a topic according to the graph, which lists a killed one for a while.

    Parameters
    ----------
    identities : frozenset
        One identifier per publisher.
    incompatible : tuple of str
        One reason per publisher whose QoS prevents receiving from it.
    hint : str
        What there is instead of publishers of the type, in words; empty if there are some.
    """

    identities: frozenset[Hashable]
    incompatible: tuple[str, ...] = ()
    hint: str = ""


@dataclass
class InputHealth:
    """One radar's stream of reports since the tracker was configured.

    Parameters
    ----------
    topic : str
        Its full name, after remapping.
    rhythm : Rhythm
        Of its usable reports, by the wall clock.

    Attributes
    ----------
    turn_found_s : float
        Time of a turn that is not set and was found out, seconds; or 0.
    lost, lost_by_overload : Lately
        Messages, and those of them that were lost because the tracker is too slow.
    fit : Fit or None
        How the radar's innovations compare with its noise, if that is known.
    """

    name: str
    topic: str
    rhythm: Rhythm
    received: int = 0
    deadlines_missed: int = 0
    incompatible_qos: int = 0
    turn_found_s: float = 0.0
    doubts: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    lost: Lately = field(default_factory=Lately)
    lost_by_overload: Lately = field(default_factory=Lately)
    fit: Fit | None = None
    _heard_s: float | None = None
    _worked_s: float = 0.0
    _numbering: SequenceNumbers = field(default_factory=SequenceNumbers)
    _listed_since_s: dict[Hashable, float] = field(default_factory=dict)
    _trouble: Lately = field(default_factory=Lately)
    _doubted: Lately = field(default_factory=Lately)
    _doubt: str = ""

    def arrived(self, now_s: float, sequence: int | None, worked_s: float) -> None:
        """Count a message and those lost before it.

        Parameters
        ----------
        sequence : int or None
            Its publisher's number for it.
        worked_s : float
            Time that the tracker has worked so far, of `now_s`.
        """
        self.received += 1
        if sequence is not None:
            before = self._numbering.lost
            self._numbering.add(sequence)
            lost = self._numbering.lost - before
            if lost > 0 and self._heard_s is not None:
                share = (worked_s - self._worked_s) / max(now_s - self._heard_s, 1e-9)
                self.lost.add(now_s, lost)
                if share > WORKING_SHARE:
                    self.lost_by_overload.add(now_s, lost)
        self._heard_s, self._worked_s = now_s, worked_s

    def pause(self) -> None:
        """Let the next message begin a new series: what came meanwhile was not to be received."""
        self._numbering.pause()
        self.rhythm.pause()
        self._heard_s = None

    @property
    def gaps(self) -> int:
        """Number of lost messages, as far as messages are numbered."""
        return self._numbering.lost

    def drop(self, reason: str, count: int, now_s: float) -> None:
        """Count detections or messages that were not used."""
        self.dropped[reason] += count
        self._trouble.add(now_s)

    def doubt(self, counts: Counter[str], text: str, now_s: float) -> None:
        """Count what was used and does not look as it is configured; `text` says what."""
        self.doubts += counts
        self._doubt = text
        self._doubted.add(now_s)

    def miss_deadline(self, count: int, now_s: float) -> None:
        """Count missed deadlines."""
        self.deadlines_missed += count
        self._trouble.add(now_s)

    def silent(self, looked_s: float, scans: float) -> bool:
        """Return whether nothing has come for `scans` of its usual intervals and the slack.

        Parameters
        ----------
        looked_s : float
            Until when all messages that have come have been received. A slow tracker is late, and
            what waits in its queue meanwhile must not count as silence.
        """
        if self._heard_s is None:
            return True
        return looked_s - self._heard_s > scans * self.rhythm.interval_s + SILENCE_SLACK_S

    def judged(
        self, now_s: float, looked_s: float, scans: float, publishers: Publishers
    ) -> tuple[bytes, str]:
        """Return the level and the message of the worst condition.

        A silent radar is STALE and not ERROR, because tracking goes on without it.
        """
        silent = self.silent(looked_s, scans)
        if self._shared(now_s, silent):
            return DiagnosticStatus.ERROR, f"several publishers on {self.topic}, must be one"
        if publishers.incompatible:
            return DiagnosticStatus.ERROR, f"incompatible QoS on {self.topic}: " + "; ".join(
                publishers.incompatible
            )
        if publishers.identities and publishers.hint:
            return DiagnosticStatus.ERROR, publishers.hint
        several = ""
        if len(publishers.identities) > 1:
            several = (
                f"{len(publishers.identities)} publishers listed on {self.topic}, must be one; "
                "a killed one disappears by itself"
            )
        if silent:
            quiet = "nothing received yet"
            if self._heard_s is not None:
                quiet = f"silent for {now_s - self._heard_s:.1f} s"
            return DiagnosticStatus.STALE, "; ".join(
                filter(None, (quiet, several, publishers.hint))
            )
        if several:
            return DiagnosticStatus.WARN, several
        if self._doubted.count(now_s):
            return DiagnosticStatus.WARN, self._doubt
        lost = self.lost.count(now_s)
        if lost:
            why = (
                "the tracker is too slow, see its step time"
                if self.lost_by_overload.count(now_s)
                else "on the way to the tracker"
            )
            return DiagnosticStatus.WARN, (
                f"{lost} messages lost in the last {WARNING_MEMORY_S:g} s: {why}"
            )
        if self._trouble.count(now_s):
            return DiagnosticStatus.WARN, "input was dropped or missed its deadline"
        wrong = None if self.fit is None else doubts.of_noise(self.fit)
        if wrong is not None:
            return DiagnosticStatus.WARN, wrong
        return DiagnosticStatus.OK, "receiving"

    def _shared(self, now_s: float, silent: bool) -> bool:
        """Return whether several publishers are alive, by their numbers or by the graph."""
        if self._numbering.several and not silent:
            return True
        lasting = [since for since in self._listed_since_s.values() if now_s - since > LEASE_S]
        return len(lasting) > 1

    def status(
        self, node: str, now_s: float, looked_s: float, scans: float, publishers: Publishers
    ) -> DiagnosticStatus:
        """Return the radar's status.

        Parameters
        ----------
        node : str
            Full name of the tracker.
        now_s, looked_s, scans : float
            See `silent`.
        """
        self._listed_since_s = {
            identity: self._listed_since_s.get(identity, now_s)
            for identity in publishers.identities
        }
        level, text = self.judged(now_s, looked_s, scans, publishers)
        values: dict[str, object] = {"topic": self.topic, "received": self.received}
        if self._heard_s is not None:
            values["age_s"] = now_s - self._heard_s
            values["interval_s"] = self.rhythm.interval_s
        values |= {
            "gaps": self.gaps,
            "deadlines_missed": self.deadlines_missed,
            "incompatible_qos": self.incompatible_qos,
            "publishers": len(publishers.identities),
            **{f"dropped_{reason}": count for reason, count in sorted(self.dropped.items())},
        }
        values |= dict(sorted(self.doubts.items()))
        if self.turn_found_s:
            values["turn_found_ms"] = round(1e3 * self.turn_found_s)
        if self.fit is not None and self.fit.seen:
            ranges, azimuths = map(float, self.fit.axes)
            values |= {"range_innovation": ranges, "azimuth_innovation": azimuths}
        return diagnostics.status(
            names.health(self.name, node), values, level, text, names.hardware(self.name, node)
        )


@dataclass
class StepHealth:
    """The tracker's own step time, and whether it keeps up.

    Parameters
    ----------
    rhythm : Rhythm
        Of the scans, by their stamps.
    pace : Rhythm
        Of the steps, by the wall clock.
    engine : str
        The tracker's, a key of `ADVICE`.
    """

    rhythm: Rhythm
    pace: Rhythm
    engine: str = "particles"
    step_ms: float | None = None
    scans: int = 0
    epoch: int = 0
    closed_by_wait: int = 0
    overdue: int = 0
    sums: Counter[str] = field(default_factory=Counter)
    _targets_seen: bool = False

    def stepped(
        self,
        stamp_ns: int,
        now_s: float,
        step_ms: float,
        targets: int = 0,
        figures: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Record a step.

        Parameters
        ----------
        stamp_ns : int
            Of its scan.
        step_ms : float
            CPU time from receipt to publication.
        targets : int
            Number of reported targets.
        figures : mapping of name to number
            Of the engine.
        """
        self.scans += 1
        self.sums.update({name: int(figures[name]) for name in SUMMED if name in figures})
        if targets:
            self._targets_seen, self.overdue = True, 0
        self.rhythm.beat(stamp_ns * 1e-9)
        self.pace.beat(now_s)
        self.step_ms = step_ms

    def pause(self) -> None:
        """Let the next step begin a new series."""
        self.rhythm.pause()
        self.pace.pause()

    def judged(self, limit: float, lost: int, busy: float) -> tuple[bytes, str]:
        """Return the level and the message; see `status`.

        The interval between the scans that were received says nothing about those that were lost,
        so losses come first.
        """
        advice = ADVICE[self.engine]
        if self.step_ms is None:
            return DiagnosticStatus.STALE, "no scan yet"
        if lost:
            return DiagnosticStatus.WARN, (
                f"overloaded, {lost} messages lost in the last {WARNING_MEMORY_S:g} s: {advice}"
            )
        if self.step_ms > limit * 1e3 * self.rhythm.interval_s:
            return DiagnosticStatus.WARN, f"too slow for the scan interval: {advice}"
        if busy > BUSY_SHARE and self.pace.interval_s > REAL_TIME * self.rhythm.interval_s:
            return DiagnosticStatus.WARN, f"at its limit, busy for {busy:.0%} of the time: {advice}"
        if self.overdue and not self._targets_seen:
            # Once there were targets, it may well be that there are none now.
            return DiagnosticStatus.WARN, doubts.no_targets(self.overdue)
        return DiagnosticStatus.OK, "in time"

    def status(self, node: str, limit: float, lost: int, busy: float) -> DiagnosticStatus:
        """Return the status of the step time.

        Parameters
        ----------
        node : str
            Full name of the tracker.
        limit : float
            Of the step time, in intervals between scans.
        lost : int
            Messages of all radars that were lost lately because the tracker is too slow.
        busy : float
            Share of the latest time in which the tracker worked.
        """
        level, text = self.judged(limit, lost, busy)
        values = {
            **({} if self.step_ms is None else {"step_ms": self.step_ms}),
            "scan_interval_ms": 1e3 * self.rhythm.interval_s,
            "busy": busy,
            "scans": self.scans,
            "epoch": self.epoch,
            "closed_by_wait": self.closed_by_wait,
            **self.sums,
            **({"scans_without_targets": self.overdue} if self.overdue else {}),
        }
        return diagnostics.status(names.health("step time", node), values, level, text, node)


@dataclass
class OutputHealth:
    """Subscriptions to the tracker's outputs that ask for incompatible QoS."""

    refused: Counter[str] = field(default_factory=Counter)
    _trouble: Lately = field(default_factory=Lately)

    def refuse(self, topic: str, count: int, now_s: float) -> None:
        """Count subscriptions that ask for incompatible QoS."""
        self.refused[topic] += count
        self._trouble.add(now_s)

    def status(self, node: str, now_s: float) -> DiagnosticStatus:
        """Return the status of the outputs; `node` is the full name of the tracker."""
        level, text = DiagnosticStatus.OK, "served"
        if self._trouble.count(now_s):
            level, text = DiagnosticStatus.WARN, "a subscription asks for incompatible QoS"
        values = {f"incompatible_qos {topic}": n for topic, n in sorted(self.refused.items())}
        return diagnostics.status(names.health("outputs", node), values, level, text, node)
