"""Watches the tracks of an engine for conflicts, step by step, and raises alarms.

Alarms do not annoy: a threshold keeps to a rate, with hysteresis and acknowledgement. As the
probabilities are calibrated, a threshold is a statement about the share of false alarms, and an
operator need not guess it: he says how many alarms an hour he can look after, and they are those of
the largest probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..engine import Engine
from ..tracks.manual import Manual
from ..types import TENTATIVE, Estimates, Pose
from .encounters import Named, predict
from .model import ConflictModel, Conflicts, words

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


class Watch:
    """Predicts the conflicts after a step, if a computation is due, and raises alarms.

    The paths are drawn from a generator that depends on the stamp alone, so that a recording has
    the conflicts that were found live.
    """

    def __init__(self, model: ConflictModel) -> None:
        self.model = model
        self.begin_run()

    def begin_run(self) -> None:
        """Forget all encounters."""
        self.alarms = Alarms(self.model.alarms_per_hour)
        self.latest: Conflicts | None = None
        self._targets: Estimates | None = None

    def step(
        self,
        stamp_ns: int,
        filtered: Sequence[Estimates],
        engine: Engine,
        own: Pose | None,
        manual: Manual,
    ) -> tuple[Conflicts, list[str]] | None:
        """Return the conflicts at the stamp of the engine's last scan, and new alarms in words.

        None if none are due. `filtered` are the estimates of the step, and `own` is own ship's
        pose; one without a velocity has no conflicts. Without it, the track that is marked as own
        ship is own ship. Friends are in no conflict with each other.
        """
        # Only what is reported can be in a conflict, and estimates need not come with every scan.
        self._targets = targets = filtered[-1] if filtered else self._targets
        before_ns = None if self.latest is None else self.latest.stamp_ns
        if before_ns is not None and 0 <= stamp_ns - before_ns < self.model.period_s * 1e9:
            return None
        if targets is None or not self.model.enabled:
            return None
        reported = targets.select((targets.track_state != TENTATIVE) & (targets.track_id > 0))
        rng = np.random.default_rng(stamp_ns)
        model = self.model
        drawn = reported.track_id, model.interval_s, model.steps, model.paths, rng
        paths = engine.paths(*drawn)
        if paths is None:
            return None
        row_of = dict(zip(reported.track_id.tolist(), reported.weight.tolist(), strict=True))
        existence = np.array([row_of[track] for track in paths.track_id.tolist()])
        moves = own is not None and bool(np.isfinite(own.velocity).all())
        names = Named(own if moves else None, manual.own, manual.friends)
        found = predict(stamp_ns, paths, existence, names, model)
        self.latest, new = self.alarms.add(found)
        return self.latest, [words(found, row, model.zones) for row in new]
