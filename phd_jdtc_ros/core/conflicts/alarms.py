"""Alarms that do not annoy: a threshold that keeps to a rate, hysteresis, and acknowledgement.

As the probabilities are calibrated, a threshold is a statement about the share of false alarms, and
an operator need not guess it: he says how many alarms an hour he can look after, and they are those
of the largest probabilities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .model import Conflicts

NONE, ALARM, ACKNOWLEDGED = range(3)
HOUR_NS = 3600 * 10**9
Key = tuple[int, int, int]


@dataclass
class Encounter:
    """A conflict from its first report on."""

    begun_ns: int
    seen_ns: int  # When it was reported last
    peak: float = 0.0  # Its largest probability
    alarm: int = NONE


@dataclass
class Alarms:
    """Raises, keeps and ends the alarms of conflicts.

    An alarm is raised when the probability reaches the threshold, and ends when the odds have
    fallen to a quarter of the threshold's, or when its conflict has not been reported for a while;
    it is never raised twice in between.

    The threshold is the largest probability that would have raised at most the wanted number of
    alarms in the last hour, or in the time since the start, in which one alarm is always allowed.
    """

    per_hour: float
    # The threshold is never outside these bounds: what is nearly certain is not kept back, and
    # what is improbable is no alarm in a quiet hour.
    least: float = 0.1
    most: float = 0.9
    release: float = 0.25  # Share of the threshold's odds at which an alarm ends
    kept_s: float = 30.0  # Time for which a conflict that is not reported goes on, seconds

    def __post_init__(self) -> None:
        self.threshold = self.least
        self._encounters: dict[Key, Encounter] = {}
        self._ended: list[Encounter] = []
        self._since_ns: int | None = None

    def add(self, found: Conflicts) -> tuple[Conflicts, list[int]]:
        """Return conflicts with their alarms, and the rows whose alarms are new."""
        now_ns = found.stamp_ns
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        for key, probability in zip(found.keys, found.probability.tolist(), strict=True):
            own = self._encounters.setdefault(key, Encounter(now_ns, now_ns))
            own.seen_ns, own.peak = now_ns, max(own.peak, probability)
        for key, own in list(self._encounters.items()):
            if now_ns - own.seen_ns > self.kept_s * 1e9:
                self._ended.append(self._encounters.pop(key))
        self._ended = [own for own in self._ended if now_ns - own.begun_ns <= HOUR_NS]
        self._choose_threshold(now_ns)
        end = self.release * self.threshold / (1.0 - self.threshold)
        states, new = np.zeros(len(found), dtype=np.int64), []
        for row, (key, probability) in enumerate(
            zip(found.keys, found.probability.tolist(), strict=True)
        ):
            own = self._encounters[key]
            if own.alarm == NONE and probability >= self.threshold:
                own.alarm = ALARM
                new.append(row)
            elif own.alarm != NONE and probability < end / (1.0 + end):
                own.alarm = NONE
            states[row] = own.alarm
        return found.changed(alarm=states), new

    def _choose_threshold(self, now_ns: int) -> None:
        hours = min(now_ns - (self._since_ns or 0), HOUR_NS) / HOUR_NS
        allowed = max(1, int(self.per_hour * hours))
        recent = (own for own in self._encounters.values() if now_ns - own.begun_ns <= HOUR_NS)
        peaks = sorted((own.peak for own in (*recent, *self._ended)), reverse=True)
        wanted = np.nextafter(peaks[allowed], 1.0) if len(peaks) > allowed else self.least
        self.threshold = float(min(max(wanted, self.least), self.most))

    def acknowledge(self) -> int:
        """Acknowledge all alarms; return the number of those that were not yet acknowledged."""
        fresh = [own for own in self._encounters.values() if own.alarm == ALARM]
        for own in fresh:
            own.alarm = ACKNOWLEDGED
        return len(fresh)

    @property
    def fresh(self) -> int:
        """Number of alarms that are not acknowledged."""
        return sum(own.alarm == ALARM for own in self._encounters.values())
