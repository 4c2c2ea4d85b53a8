"""The health of the tracker's inputs, as diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.encoding import names
from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.quoting import counts_text

from ..common.health import WARNING_MEMORY_S, Condition, Rhythm, Rises, first, status_of
from ..common.topics import SequenceNumbers

ERROR, STALE, WARN = DiagnosticStatus.ERROR, DiagnosticStatus.STALE, DiagnosticStatus.WARN

# An input is silent after this number of its usual intervals and the slack. Two checks, up to
# 0.2 s, and the transport of the message add to this: silence is reported within half a second.
SILENT_AFTER_SCANS, SILENCE_SLACK_S = 2.0, 0.25
# A killed publisher stays in the graph for the middleware's lease, by default at most 20 s. Two
# that are listed together for longer than this must both be alive.
LEASE_S = 30.0
# Faults of single detections, or clouds, are a warning if they are more than a normal share of all
# of the last minute, and until they are less than this part of it. Of fewer than LEAST one fault is
# no share.
RECOVERED, LEAST, MINUTE_S = 0.4, 40, 60.0


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
    _minute: Rises = field(default_factory=lambda: Rises(MINUTE_S))
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
        """Return the kinds of single faults that are many, each with its recent share."""
        clouds = self._minute.recent("clouds", self.received, now_s)
        detections = self._minute.recent("detections", self.detections, now_s)
        many = {}
        for what, total in self._single.items():
            offered = max(clouds if what in anomalies.OF_CLOUDS else detections, LEAST)
            share = self._minute.recent(what, total, now_s) / offered
            normal = anomalies.NORMAL.get(what, anomalies.MANY)
            if share > (RECOVERED * normal if what in self._many else normal):
                many[what] = share
        self._many = many
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
            (DiagnosticStatus.OK, True, "receiving"),
        )

    def _has_several_publishers(self, now_s: float, silent: bool) -> bool:
        """Return whether several publishers are alive, by their numbers or by the graph."""
        if self.shared:
            return False
        if self._numbering.several and not silent:
            return True
        return sum(now_s - since_s > LEASE_S for since_s in self._listed_since_s.values()) > 1
