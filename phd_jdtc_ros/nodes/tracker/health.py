# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How the tracker's inputs and steps are doing, as diagnostics.

Ages are by the wall clock: a radar whose driver has died sends no stamps to go by.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable
from dataclasses import dataclass, field
from statistics import median

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics

from .sequence_numbers import SequenceNumbers

# A radar is silent this much after the scans that it may miss, at the latest half a second after.
SILENCE_SLACK_S = 0.3
# A warning stays this long after its cause.
WARNING_MEMORY_S = 10.0
# A killed publisher is in the graph for the middleware's lease, of 20 s at the most as it comes.
# Those that are there together for longer have lived together.
LEASE_S = 30.0
# Intervals that the usual one is taken from.
KEPT_INTERVALS = 9


class Rhythm:
    """The usual interval of something that comes again and again: the median of the latest.

    Parameters
    ----------
    first_guess_s : float
        Counts as one interval, so that the first two arriving together are not taken for a rate.
    """

    def __init__(self, first_guess_s: float) -> None:
        self._intervals = deque([first_guess_s], maxlen=KEPT_INTERVALS)
        self._last_s: float | None = None

    def beat(self, now_s: float) -> None:
        """Take note of one more."""
        if self._last_s is not None and now_s > self._last_s:
            self._intervals.append(now_s - self._last_s)
        self._last_s = now_s

    def pause(self) -> None:
        """Take the next one for the first of another run."""
        self._last_s = None

    @property
    def interval_s(self) -> float:
        """The usual interval, seconds."""
        return median(self._intervals)


@dataclass(frozen=True)
class Publishers:
    """Who publishes on a topic as the graph has it: a killed one stays there for a while.

    Parameters
    ----------
    identities : frozenset
        What the middleware tells them apart by.
    incompatible : tuple of str
        Why those that cannot be heard cannot, one entry each.
    """

    identities: frozenset[Hashable]
    incompatible: tuple[str, ...] = ()


@dataclass
class InputHealth:
    """One radar's stream since the tracker was configured.

    Parameters
    ----------
    name, topic : str
    rhythm : Rhythm
        Of its usable reports, wall clock.
    """

    name: str
    topic: str
    rhythm: Rhythm
    received: int = 0
    deadlines_missed: int = 0
    incompatible_qos: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    _heard_s: float | None = None
    _numbering: SequenceNumbers = field(default_factory=SequenceNumbers)
    _listed_since_s: dict[Hashable, float] = field(default_factory=dict)
    _trouble_s: float | None = None

    def arrived(self, now_s: float, sequence: int | None) -> None:
        """Count a message and those lost before it; `sequence` is its publication's number."""
        self.received += 1
        self._heard_s = now_s
        if sequence is not None:
            self._numbering.add(sequence)

    @property
    def gaps(self) -> int:
        """Messages that were published and did not come, of those numbered."""
        return self._numbering.lost

    def drop(self, reason: str, count: int, now_s: float) -> None:
        """Count what was not used."""
        self.dropped[reason] += count
        self._trouble_s = now_s

    def miss_deadline(self, count: int, now_s: float) -> None:
        """Count missed deadlines."""
        self.deadlines_missed += count
        self._trouble_s = now_s

    def silent(self, now_s: float, scans: float) -> bool:
        """Return whether nothing has come for `scans` of its usual intervals and a little."""
        if self._heard_s is None:
            return True
        return now_s - self._heard_s > scans * self.rhythm.interval_s + SILENCE_SLACK_S

    def judged(self, now_s: float, scans: float, heard: Publishers) -> tuple[bytes, str]:
        """Return the level and what it says; the worst counts.

        A silent radar is STALE: nothing is known of it, and tracking goes on without it.
        """
        if self._shared(now_s, scans):
            return DiagnosticStatus.ERROR, f"several publishers on {self.topic}, must be one"
        if heard.incompatible:
            return DiagnosticStatus.ERROR, f"incompatible QoS on {self.topic}: " + "; ".join(
                heard.incompatible
            )
        if self._heard_s is None:
            return DiagnosticStatus.STALE, "nothing received yet"
        if self.silent(now_s, scans):
            return DiagnosticStatus.STALE, f"silent for {now_s - self._heard_s:.1f} s"
        if len(heard.identities) > 1:
            return DiagnosticStatus.WARN, (
                f"{len(heard.identities)} publishers listed on {self.topic}, must be one; "
                "a killed one goes by itself"
            )
        if self._trouble_s is not None and now_s - self._trouble_s < WARNING_MEMORY_S:
            return DiagnosticStatus.WARN, "input was dropped or missed its deadline"
        return DiagnosticStatus.OK, "receiving"

    def _shared(self, now_s: float, scans: float) -> bool:
        """Return whether more than one publisher lives: by what they send, or by the graph."""
        if self._numbering.several and not self.silent(now_s, scans):
            return True
        long = [since for since in self._listed_since_s.values() if now_s - since > LEASE_S]
        return len(long) > 1

    def status(self, node: str, now_s: float, scans: float, heard: Publishers) -> DiagnosticStatus:
        """Return the radar's line."""
        self._listed_since_s = {
            identity: self._listed_since_s.get(identity, now_s) for identity in heard.identities
        }
        level, text = self.judged(now_s, scans, heard)
        values: dict[str, object] = {"topic": self.topic, "received": self.received}
        if self._heard_s is not None:
            values["age_s"] = now_s - self._heard_s
            values["interval_s"] = self.rhythm.interval_s
        values |= {
            "gaps": self.gaps,
            "deadlines_missed": self.deadlines_missed,
            "incompatible_qos": self.incompatible_qos,
            "publishers": len(heard.identities),
            **{f"dropped_{reason}": count for reason, count in sorted(self.dropped.items())},
        }
        return diagnostics.status(f"{node}: {self.name}", values, level, text, self.name)


@dataclass
class StepHealth:
    """The tracker's own pace.

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
        """Take note of a step: its scan's stamp, and the CPU time from receipt to publication."""
        self.scans += 1
        self.rhythm.beat(stamp_ns * 1e-9)
        self.step_ms = step_ms

    def status(self, node: str, hardware_id: str, limit: float) -> DiagnosticStatus:
        """Return the line of the step time; `limit` is in intervals between scans."""
        interval_ms = 1e3 * self.rhythm.interval_s
        level, text = DiagnosticStatus.OK, "in time"
        if self.step_ms is None:
            level, text = DiagnosticStatus.STALE, "no scan yet"
        elif self.step_ms > limit * interval_ms:
            level, text = DiagnosticStatus.WARN, "too slow for the scans"
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
    """Who asked for what the tracker publishes and cannot have it."""

    refused: Counter[str] = field(default_factory=Counter)
    _trouble_s: float | None = None

    def refuse(self, topic: str, count: int, now_s: float) -> None:
        """Count subscriptions that ask for incompatible QoS."""
        self.refused[topic] += count
        self._trouble_s = now_s

    def status(self, node: str, hardware_id: str, now_s: float) -> DiagnosticStatus:
        """Return the outputs' line."""
        level, text = DiagnosticStatus.OK, "served"
        if self._trouble_s is not None and now_s - self._trouble_s < WARNING_MEMORY_S:
            level, text = DiagnosticStatus.WARN, "a subscription asks for incompatible QoS"
        values = {f"incompatible_qos {topic}": n for topic, n in sorted(self.refused.items())}
        return diagnostics.status(f"{node}: outputs", values, level, text, hardware_id)
