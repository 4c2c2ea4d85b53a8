"""Watches the tracks of an engine for conflicts, step by step, and raises alarms.

Alarms do not annoy: a threshold keeps to a rate, with hysteresis and acknowledgement. As the
probabilities are calibrated, a threshold is a statement about the share of false alarms, and an
operator need not guess it: he says how many alarms an hour he can look after, and they are those of
the largest probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float3, compiled
from ..engine import Engine, Paths
from ..models.zones import Zone
from ..tracks.manual import Manual
from ..types import TENTATIVE, Estimates, Pose
from .model import OWN, OWN_SHIP, PAIR, ZONE, ConflictModel, Conflicts, closest_approach, words


@compiled
def _times_of_approach(first: Float3, second: Float3, distance: float, height: float) -> FloatArray:
    """Return when each pair of paths, (N, K + 1, 3), is first too near, in intervals, (N,).

    It is infinite for never. The distance is between straight lines from point to point. Heights
    count if `height` is positive and both are known.
    """
    count, points, _ = first.shape
    times = np.full(count, np.inf)
    for n in range(count):
        for k in range(points - 1):
            x, y = second[n, k, 0] - first[n, k, 0], second[n, k, 1] - first[n, k, 1]
            dx = second[n, k + 1, 0] - first[n, k + 1, 0] - x
            dy = second[n, k + 1, 1] - first[n, k + 1, 1] - y
            # The distance is below the least one between the roots of a quadratic.
            square, half = dx * dx + dy * dy, x * dx + y * dy
            excess = x * x + y * y - distance * distance
            begin, end = 0.0, 1.0
            if square > 0.0:
                discriminant = half * half - square * excess
                if discriminant < 0.0:
                    continue
                root = np.sqrt(discriminant)
                begin, end = max(begin, (-half - root) / square), min(end, (-half + root) / square)
            elif excess > 0.0:
                continue
            z = second[n, k, 2] - first[n, k, 2]
            if height > 0.0 and not np.isnan(z):
                dz = second[n, k + 1, 2] - first[n, k + 1, 2] - z
                if dz != 0.0:
                    low, high = (-height - z) / dz, (height - z) / dz
                    begin, end = max(begin, min(low, high)), min(end, max(low, high))
                elif abs(z) >= height:
                    continue
            if begin <= end:
                times[n] = k + begin
                break
    return times


@compiled
def _times_of_crossing(path: Float3, sides: Float3) -> FloatArray:
    """Return when each path, (N, K + 1, 3), first crosses one of some sides, (S, 2, 2).

    The times are in intervals, (N,); infinite for never.
    """
    count, points, _ = path.shape
    times = np.full(count, np.inf)
    for n in range(count):
        for k in range(points - 1):
            x, y = path[n, k, 0], path[n, k, 1]
            dx, dy = path[n, k + 1, 0] - x, path[n, k + 1, 1] - y
            for side in sides:
                ex, ey = side[1, 0] - side[0, 0], side[1, 1] - side[0, 1]
                area = dx * ey - dy * ex
                if area != 0.0:
                    px, py = side[0, 0] - x, side[0, 1] - y
                    along, across = (px * ey - py * ex) / area, (px * dy - py * dx) / area
                    if 0.0 <= along <= 1.0 and 0.0 <= across <= 1.0:
                        times[n] = min(times[n], k + along)
            if times[n] <= k + 1:
                break
    return times


def straight_path(own: Pose, model: ConflictModel) -> FloatArray:
    """Return the path of own ship at its present course and speed as `Paths.place`, (1, N, K, 3).

    What a mariner asks is what happens if own ship stands on.
    """
    times = model.interval_s * np.arange(model.steps + 1)
    place = np.full((1, model.paths, model.steps + 1, 3), np.nan)
    place[..., :2] = np.array(own.position) + times[:, None] * np.array(own.velocity)
    return place


def _candidates(place: FloatArray, distance: float) -> list[tuple[int, int]]:
    """Return the pairs of objects, by ascending index, some of whose paths may be too near.

    They are judged by circles around all paths of each object at each time.
    """
    centres = place[..., :2].mean(axis=1)
    radii = np.hypot(*np.moveaxis(place[..., :2] - centres[:, None], -1, 0)).max(axis=1)
    # Longest way of each object in an interval.
    step = np.hypot(*np.moveaxis(np.diff(place[..., :2], axis=2), -1, 0)).max(axis=(1, 2))
    near = np.zeros((len(step), len(step)), dtype=np.bool_)
    for centre, radius in zip(centres.transpose(1, 0, 2), radii.T, strict=True):
        # Both may come nearer on the way to and from this time.
        around = radius + 0.5 * step
        gap = np.hypot(*(centre[:, None] - centre).transpose(2, 0, 1))
        near |= gap <= around[:, None] + around + distance
    first, second = np.triu(near, 1).nonzero()
    return list(zip(first.tolist(), second.tolist(), strict=True))


class Named(NamedTuple):
    """Who is own ship, and who need not be watched."""

    own: Pose | None = None  # Own ship's pose, if it is known
    tracks: frozenset[int] = frozenset()  # Tracks that are own ship
    friends: frozenset[int] = frozenset()  # Tracks that are in no conflict with each other


def predict(
    stamp_ns: int, paths: Paths, existence: FloatArray, named: Named, model: ConflictModel
) -> Conflicts:
    """Return the conflicts of the tracks and of own ship, if it is known.

    `existence` has the probability that the target of each track exists, (T,).
    """
    number, place, own = *paths, named.own
    mine = np.isin(number, [*named.tracks])
    if own is None and mine.any():
        first = int(mine.argmax())
        order = np.concatenate([[first], np.flatnonzero(~mine)])
        number, place, existence = number[order], place[order], existence[order]
        number[0] = OWN_SHIP
    elif mine.any():
        number, place, existence = number[~mine], place[~mine], existence[~mine]
    if own is not None:
        number = np.concatenate([[OWN_SHIP], number])
        existence = np.concatenate([[1.0], existence])
        place = np.concatenate([straight_path(own, model), place])
    found: list[tuple[float, ...]] = []
    mean = place[..., :2].mean(axis=1)
    velocity = (mean[:, 1] - mean[:, 0]) / model.interval_s
    pairs = _candidates(place, model.distance) if model.distance > 0.0 else []
    friends = {OWN_SHIP, *named.friends}
    for one, other in pairs:
        if {int(number[one]), int(number[other])} <= friends:
            continue
        times = flat = _times_of_approach(place[one], place[other], model.distance, 0.0)
        if model.height:
            times = _times_of_approach(place[one], place[other], model.distance, model.height)
        share, median = _summary(times, flat, existence[one] * existence[other], model)
        if share >= model.least_probability:
            line, relative = mean[other, 0] - mean[one, 0], velocity[other] - velocity[one]
            approach = closest_approach(line, relative, velocity[one])
            kind = OWN if number[one] == OWN_SHIP else PAIR
            names = kind, number[one], number[other]
            at = mean[other, round(median)]
            found.append((*names, share, median * model.interval_s, *approach, *at))
    for index, zone in enumerate(model.zones):
        for one in range(len(number)):
            times = _times_of_entry(place[one], zone)
            share, median = _summary(times, times, existence[one], model)
            if share >= model.least_probability:
                names, at = (ZONE, number[one], index), mean[one, round(median)]
                unknown = (math.nan,) * 4
                found.append((*names, share, median * model.interval_s, *unknown, *at))
    found.sort(key=lambda row: (-row[3], row[:3]))
    columns = np.array(found, dtype=np.float64).reshape(-1, 11).T
    whole, real = columns[:3].astype(np.int64), columns[3:9]
    of_name = dict(zip(("kind", "first", "second"), whole, strict=True))
    of_name |= dict(
        zip(("probability", "time_s", "cpa", "tcpa_s", "ahead", "starboard"), real, strict=True)
    )
    of_name |= {"place": np.ascontiguousarray(columns[9:].T), "alarm": np.zeros_like(whole[0])}
    return Conflicts(stamp_ns, **of_name)


def _summary(
    times: FloatArray, flat: FloatArray, existence: float, model: ConflictModel
) -> tuple[float, float]:
    """Return the probability of an event, and its median time; `times` are infinite for never.

    `flat` are the times whatever the heights are: only motions in the plane need calibration.
    """
    happens = times[np.isfinite(times)]
    if not len(happens):
        return 0.0, 0.0
    near = np.isfinite(flat).sum()
    probability = model.calibrated(near / len(times)) * len(happens) / near
    return min(float(existence), 1.0) * probability, float(np.median(happens))


def _times_of_entry(path: FloatArray, zone: Zone) -> FloatArray:
    """Return when each path, (N, K + 1, 3), is first in a zone, in intervals, (N,)."""
    corners = path[..., :2].reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if (low > zone.bounds[1]).any() or (high < zone.bounds[0]).any():
        return np.full(len(path), np.inf)
    ends = zone.sides
    near = ((ends.max(axis=1) >= low) & (ends.min(axis=1) <= high)).all(axis=1)
    times = _times_of_crossing(path, np.ascontiguousarray(ends[near]))
    times[zone.contains(path[:, 0, :2])] = 0.0
    return times


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
        rng, model = np.random.default_rng(stamp_ns), self.model
        paths = engine.paths(reported.track_id, model.interval_s, model.steps, model.paths, rng)
        if paths is None:
            return None
        row_of = {track: row for row, track in enumerate(reported.track_id.tolist())}
        rows = np.array([row_of[track] for track in paths.track_id.tolist()], dtype=np.int64)
        existence, known = reported.weight[rows], reported.attributes
        if model.height and known is not None and not reported.space.vertical:
            age_s, size = (stamp_ns - reported.stamp_ns) * 1e-9, (model.paths, model.steps + 1)
            flown = known.take(rows), age_s, model.interval_s, size, rng
            paths.place[..., 2] = model.level_flight.paths(*flown)
        moves = own is not None and bool(np.isfinite(own.velocity).all())
        names = Named(own if moves else None, manual.own, manual.friends)
        found = predict(stamp_ns, paths, existence, names, model)
        self.latest, new = self.alarms.add(found)
        return self.latest, [words(found, row, model.zones) for row in new]
