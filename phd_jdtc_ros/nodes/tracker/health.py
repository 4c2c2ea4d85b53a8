# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of the tracker's inputs, steps and outputs, as diagnostics.

Ages are measured by the wall clock, because a radar whose driver has died sends no more stamps.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable
from dataclasses import dataclass, field
from statistics import median

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics

from ..common.sequence_numbers import SequenceNumbers

# Added to the scans that a radar may miss. Noticing it takes up to 0.1 s more, so that a radar is
# reported silent within half a second after those scans.
SILENCE_SLACK_S = 0.3
# How long a warning stays after its cause.
WARNING_MEMORY_S = 10.0
# A killed publisher stays in the graph for the middleware's lease, by default at most 20 s. Two
# that are listed together for longer than this must both be alive.
LEASE_S = 30.0
# Number of latest intervals whose median is the usual one.
KEPT_INTERVALS = 9


class Rhythm:
    """The usual interval between repeated events: the median of the latest ones.

    Parameters
    ----------
    first_guess_s : float
        Counts as one interval, so that the first two events arriving together are not taken as
        the usual interval.
    """

    def __init__(self, first_guess_s: float) -> None:
        self._intervals = deque([first_guess_s], maxlen=KEPT_INTERVALS)
        self._last_s: float | None = None

    def beat(self, now_s: float) -> None:
        """Record an event."""
        if self._last_s is not None and now_s > self._last_s:
            self._intervals.append(now_s - self._last_s)
        self._last_s = now_s

    def pause(self) -> None:
        """Let the next event begin a new series, so that the interval before it does not count."""
        self._last_s = None

    @property
    def interval_s(self) -> float:
        """The usual interval, seconds."""
        return median(self._intervals)


@dataclass(frozen=True)
class Publishers:
    """The publishers on a topic according to the graph, which lists a killed one for a while.

    Parameters
    ----------
    identities : frozenset
        One identifier per publisher.
    incompatible : tuple of str
        One reason per publisher whose QoS prevents receiving from it.
    """

    identities: frozenset[Hashable]
    incompatible: tuple[str, ...] = ()


@dataclass
class InputHealth:
    """One radar's stream of reports since the tracker was configured.

    Parameters
    ----------
    name, topic : str
    rhythm : Rhythm
        Of its usable reports, by the wall clock.
    """

    name: str
    topic: str
    rhythm: Rhythm
    received: int = 0
    deadlines_missed: int = 0
    incompatible_qos: int = 0
    azimuths_beyond_a_turn: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    _heard_s: float | None = None
    _numbering: SequenceNumbers = field(default_factory=SequenceNumbers)
    _listed_since_s: dict[Hashable, float] = field(default_factory=dict)
    _trouble_s: float | None = None
    _doubt_s: float | None = None

    def arrived(self, now_s: float, sequence: int | None) -> None:
        """Count a message and those lost before it; `sequence` is its publisher's number for it."""
        self.received += 1
        self._heard_s = now_s
        if sequence is not None:
            self._numbering.add(sequence)

    @property
    def gaps(self) -> int:
        """Number of lost messages, as far as messages are numbered."""
        return self._numbering.lost

    def drop(self, reason: str, count: int, now_s: float) -> None:
        """Count detections or messages that were not used."""
        self.dropped[reason] += count
        self._trouble_s = now_s

    def doubt(self, count: int, now_s: float) -> None:
        """Count azimuths beyond a whole turn, which were used."""
        self.azimuths_beyond_a_turn += count
        self._doubt_s = now_s

    def miss_deadline(self, count: int, now_s: float) -> None:
        """Count missed deadlines."""
        self.deadlines_missed += count
        self._trouble_s = now_s

    def silent(self, now_s: float, scans: float) -> bool:
        """Return whether nothing has come for `scans` of its usual intervals and the slack."""
        if self._heard_s is None:
            return True
        return now_s - self._heard_s > scans * self.rhythm.interval_s + SILENCE_SLACK_S

    def judged(self, now_s: float, scans: float, publishers: Publishers) -> tuple[bytes, str]:
        """Return the level and the message of the worst condition.

        A silent radar is STALE and not ERROR, because tracking goes on without it.
        """
        if self._shared(now_s, scans):
            return DiagnosticStatus.ERROR, f"several publishers on {self.topic}, must be one"
        if publishers.incompatible:
            return DiagnosticStatus.ERROR, f"incompatible QoS on {self.topic}: " + "; ".join(
                publishers.incompatible
            )
        if self._heard_s is None:
            return DiagnosticStatus.STALE, "nothing received yet"
        if self.silent(now_s, scans):
            return DiagnosticStatus.STALE, f"silent for {now_s - self._heard_s:.1f} s"
        if len(publishers.identities) > 1:
            return DiagnosticStatus.WARN, (
                f"{len(publishers.identities)} publishers listed on {self.topic}, must be one; "
                "a killed one disappears by itself"
            )
        if self._doubt_s is not None and now_s - self._doubt_s < WARNING_MEMORY_S:
            return DiagnosticStatus.WARN, "azimuths beyond 2 pi rad, probably degrees"
        if self._trouble_s is not None and now_s - self._trouble_s < WARNING_MEMORY_S:
            return DiagnosticStatus.WARN, "input was dropped or missed its deadline"
        return DiagnosticStatus.OK, "receiving"

    def _shared(self, now_s: float, scans: float) -> bool:
        """Return whether several publishers are alive, by their numbers or by the graph."""
        if self._numbering.several and not self.silent(now_s, scans):
            return True
        lasting = [since for since in self._listed_since_s.values() if now_s - since > LEASE_S]
        return len(lasting) > 1

    def status(
        self, node: str, now_s: float, scans: float, publishers: Publishers
    ) -> DiagnosticStatus:
        """Return the radar's status."""
        self._listed_since_s = {
            identity: self._listed_since_s.get(identity, now_s)
            for identity in publishers.identities
        }
        level, text = self.judged(now_s, scans, publishers)
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
        if self.azimuths_beyond_a_turn:
            values["azimuths_beyond_a_turn"] = self.azimuths_beyond_a_turn
        return diagnostics.status(f"{node}: {self.name}", values, level, text, self.name)


@dataclass
class StepHealth:
    """The tracker's own step time.

    Parameters
    ----------
    rhythm : Rhythm
        Of the scans, by their stamps.
    """

    rhythm: Rhythm
    step_ms: float | None = None
    scans: int = 0
    epoch: int = 0
    closed_by_wait: int = 0

    def stepped(self, stamp_ns: int, step_ms: float) -> None:
        """Record a step: its scan's stamp, and the CPU time from receipt to publication."""
        self.scans += 1
        self.rhythm.beat(stamp_ns * 1e-9)
        self.step_ms = step_ms

    def status(self, node: str, hardware_id: str, limit: float) -> DiagnosticStatus:
        """Return the status of the step time; `limit` is in intervals between scans."""
        interval_ms = 1e3 * self.rhythm.interval_s
        level, text = DiagnosticStatus.OK, "in time"
        if self.step_ms is None:
            level, text = DiagnosticStatus.STALE, "no scan yet"
        elif self.step_ms > limit * interval_ms:
            level, text = DiagnosticStatus.WARN, "too slow for the scan interval"
        values = {
            **({} if self.step_ms is None else {"step_ms": self.step_ms}),
            "scan_interval_ms": interval_ms,
            "scans": self.scans,
            "epoch": self.epoch,
            "closed_by_wait": self.closed_by_wait,
        }
        return diagnostics.status(f"{node}: step time", values, level, text, hardware_id)


@dataclass
class OutputHealth:
    """Subscriptions to the tracker's outputs that ask for incompatible QoS."""

    refused: Counter[str] = field(default_factory=Counter)
    _trouble_s: float | None = None

    def refuse(self, topic: str, count: int, now_s: float) -> None:
        """Count subscriptions that ask for incompatible QoS."""
        self.refused[topic] += count
        self._trouble_s = now_s

    def status(self, node: str, hardware_id: str, now_s: float) -> DiagnosticStatus:
        """Return the status of the outputs."""
        level, text = DiagnosticStatus.OK, "served"
        if self._trouble_s is not None and now_s - self._trouble_s < WARNING_MEMORY_S:
            level, text = DiagnosticStatus.WARN, "a subscription asks for incompatible QoS"
        values = {f"incompatible_qos {topic}": n for topic, n in sorted(self.refused.items())}
        return diagnostics.status(f"{node}: outputs", values, level, text, hardware_id)
