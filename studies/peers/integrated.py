"""Joint integrated probabilistic data association (JIPDA) with several motions and a smoother.

All tracks share the detections of a look by loopy belief propagation, and each has a probability of
existence. Three extended Kalman filters of white acceleration interact in a track, and a
Rauch-Tung-Striebel smoother goes back over a lag. It is told the true sensors: noise, detection
probability and clutter over range, blind sectors, fields of view, ambiguity of range rates, poses.
A revolution is a look for each of its parts.

Letters: T tracks, M motions, J detections, D measured components; a state is x, vx, y, vy.

References
----------
Musicki and Evans, "Joint integrated probabilistic data association: JIPDA", IEEE Transactions on
Aerospace and Electronic Systems 40(3), 2004; Williams and Lau, "Approximate evaluation of marginal
association probabilities with belief propagation", ibid. 50(4), 2014.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import FULL_TURN, Coverage
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport

POSITION, VELOCITY, AXES = [0, 2], [1, 3], 4
# Probabilities to change from one motion to another in an interval, and those of a new track.
CHANGE = np.array([[0.95, 0.04, 0.01], [0.05, 0.9, 0.05], [0.05, 0.1, 0.85]])
FIRST = np.array([0.5, 0.3, 0.2])
MOTIONS = len(FIRST)
GATE = 30.0  # Squared Mahalanobis distance
PARTS = 16  # Looks of a revolution
# Probability to survive an interval, and probabilities from which a track is confirmed, until which
# it stays so, and below which it and what is born is dropped.
SURVIVAL, CONFIRM, DELETE, LEAST, LEAST_BORN = 0.99, 0.95, 0.3, 1e-4, 2e-5
# A smoothed track is reported where it is confirmed within the lag, and this probable once.
LEAST_SMOOTHED = 0.9
MOST_TRACKS = 500
# Part of the ambiguity interval from which a predicted range rate is too vague to tell its fold,
# and the standard deviation that then stands for its noise, metres per second.
VAGUE, UNKNOWN_RATE = 3.5, 1e6


@dataclass(frozen=True)
class Settings:
    """What the peer assumes of the targets."""

    densities: tuple[float, float, float]  # Of the white acceleration of each motion, m^2/s^3
    births: float  # Expected number of targets that appear in an interval
    velocity_std: float  # Of a new target, per axis, metres per second
    near: float  # Distance along an axis within which two tracks may be one target's, metres
    interval_s: float
    lag_s: float


class Look(NamedTuple):
    """What a radar saw at one time."""

    time_s: float
    radar: RadarModel  # In its pose at that time
    measurement: FloatArray  # Range and azimuth in the radar's frame, (J, 2)
    later_s: FloatArray  # Time of each detection after the look, (J,)
    rates: FloatArray | None = None  # Range rates, (J,)
    part: Coverage | None = None  # The azimuths of a part of a revolution, in the radar's frame


def looks_of(scenario: Scenario, reports: Sequence[SimulatedReport]) -> list[Look]:
    """Return the looks of reports, of whole revolutions where the antenna turns, by time."""
    looks = []
    for report in reports:
        found, end_s = report.detections, (report.stamp_ns - scenario.start_ns) * 1e-9
        own, rotation_s = report.radar, scenario.radars[report.radar].rotation_s
        if not rotation_s:
            model, later = scenario.radar_at(own, end_s), np.zeros(len(found))
            looks.append(Look(end_s, model, found.measurement, later, found.range_rate))
            continue
        antenna, width = scenario.antennas[own], rotation_s / PARTS
        offset = np.zeros(len(found)) if found.time_s is None else found.time_s
        for k in range(PARTS):
            begin = end_s - rotation_s + k * width
            inside = np.flatnonzero(np.floor((offset + rotation_s) / width).astype(int) == k)
            turned = float(antenna.revolutions_at(np.array(begin), rotation_s)) * FULL_TURN
            start = 0.5 * np.pi + (-turned - FULL_TURN / PARTS if antenna.clockwise else turned)
            middle = begin + 0.5 * width
            looks.append(
                Look(
                    middle,
                    scenario.radar_at(own, middle),
                    found.measurement[inside],
                    end_s + offset[inside] - middle,
                    None if found.range_rate is None else found.range_rate[inside],
                    Coverage(start, FULL_TURN / PARTS),
                )
            )
    return sorted(looks, key=lambda look: look.time_s)


def _transition(dt: float, density: float) -> tuple[FloatArray, FloatArray]:
    matrix, noise = np.eye(AXES), np.zeros((AXES, AXES))
    matrix[0, 1] = matrix[2, 3] = dt
    axis = density * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    noise[:2, :2] = noise[2:, 2:] = axis
    return matrix, noise


def marginals(
    missed: FloatArray, weight: FloatArray, other: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the probabilities of no detection, (T,), of each, (T, J), and of none's, (J,).

    `missed`, (T,), are the weights of no detection, `weight`, (T, J), those of the pairs, and
    `other`, (J,), those of a detection from elsewhere.
    """
    if not weight.size:
        return np.ones(len(missed)), weight, np.ones(len(other))
    ratio = weight / missed[:, None] / other
    message = np.ones_like(ratio)
    for _ in range(60):
        product = ratio * message
        up = ratio / (1.0 + product.sum(1, keepdims=True) - product)
        new = 1.0 / (1.0 + up.sum(0, keepdims=True) - up)
        done = np.abs(new - message).max() < 1e-6
        message = new
        if done:
            break
    product = ratio * message
    total = 1.0 + product.sum(1, keepdims=True)
    up = ratio / (total - product)
    return 1.0 / total[:, 0], product / total, 1.0 / (1.0 + up.sum(0))


def _mixed(weight: FloatArray, mean: FloatArray, spread: FloatArray) -> tuple[FloatArray, ...]:
    """Return mean and covariance of mixtures over the last axis of their weights, (..., M)."""
    middle = (weight[..., None] * mean).sum(-2)
    off = mean - middle[..., None, :]
    each = spread + off[..., :, None] * off[..., None, :]
    return middle, (weight[..., None, None] * each).sum(-3)


class _Seen(NamedTuple):
    """The tracks as a radar measures them."""

    error: FloatArray  # Of each track, motion and detection, (T, M, J, D)
    spread: FloatArray  # Of innovations, (T, M, D, D)
    gain: FloatArray  # (T, M, 4, D)
    detection: FloatArray  # Probability of detection, (T, M)


class _Past(NamedTuple):
    """A track after a look."""

    time_s: float
    mean: FloatArray
    covariance: FloatArray
    predicted: tuple[FloatArray, FloatArray]  # Mean and covariance before the look
    existence: float
    confirmed: bool


@dataclass
class Tracker:
    """The tracks, one row each."""

    settings: Settings
    radars: int  # Number of radars, which share the births
    time_s: float = 0.0
    mean: FloatArray = field(default_factory=lambda: np.zeros((0, MOTIONS, AXES)))
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, MOTIONS, AXES, AXES)))
    motion: FloatArray = field(default_factory=lambda: np.zeros((0, MOTIONS)))
    existence: FloatArray = field(default_factory=lambda: np.zeros(0))
    confirmed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    number: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    numbers: int = 0
    history: dict[int, list[_Past]] = field(default_factory=dict)

    def add(self, time_s: float, look: Look | None) -> None:
        """Predict all tracks to a time, and update them with a look, if there is one."""
        self._predict(time_s)
        before = _mixed(self.motion, self.mean, self.covariance)
        known = {n: (m, c) for n, m, c in zip(self.number.tolist(), *before, strict=True)}
        if look is not None:
            self._update(look)
        self._keep(self._distinct())
        self.confirmed = self.existence > np.where(self.confirmed, DELETE, CONFIRM)
        after = _mixed(self.motion, self.mean, self.covariance)
        for row, number in enumerate(self.number.tolist()):
            now = after[0][row], after[1][row]
            past = (self.existence[row], bool(self.confirmed[row]))
            entry = _Past(time_s, *now, known.get(number, now), *past)
            self.history.setdefault(number, []).append(entry)
        alive = set(self.number.tolist())
        for number in [n for n in self.history if n not in alive]:
            if not any(past.confirmed for past in self.history[number]):
                del self.history[number]

    def report(self) -> PointSet:
        """Return the confirmed tracks."""
        mean, covariance = _mixed(self.motion, self.mean, self.covariance)
        rows = np.flatnonzero(self.confirmed)
        return _points(self.number[rows], mean[rows], covariance[rows])

    def _predict(self, time_s: float) -> None:
        dt, self.time_s = time_s - self.time_s, time_s
        if dt <= 0.0 or not len(self.number):
            return
        intervals = dt / self.settings.interval_s
        part = min(intervals, 1.0)
        change = np.eye(MOTIONS) * (1.0 - part) + CHANGE * part
        if intervals > 1.0:
            change = np.linalg.matrix_power(CHANGE, round(intervals))
        total = self.motion @ change
        weight = np.swapaxes(self.motion[:, :, None] * change / total[:, None], 1, 2)
        mean, covariance = _mixed(weight, self.mean[:, None], self.covariance[:, None])
        for row, density in enumerate(self.settings.densities):
            matrix, noise = _transition(dt, density)
            self.mean[:, row] = mean[:, row] @ matrix.T
            self.covariance[:, row] = matrix @ covariance[:, row] @ matrix.T + noise
        self.motion, self.existence = total, self.existence * SURVIVAL**intervals

    def _update(self, look: Look) -> None:
        clutter, born = self._intensities(look)
        seen = self._seen(look)
        likelihood = _likelihood(seen, look)
        free = self._associate(seen, likelihood, clutter + born)
        self._start(look, free, clutter, born)

    def _intensities(self, look: Look) -> tuple[FloatArray, FloatArray]:
        """Return the intensities of clutter and births at the detections, (J,)."""
        view, distance = look.radar.visibility, look.measurement[:, 0]
        per_area = np.full(len(distance), look.radar.clutter_rate / view.clutter_range)
        if view.clutter_density:
            grid = np.linspace(view.min_range, view.clutter_range, 2001)
            mean = np.interp(grid, view.clutter_ranges, view.clutter_density).mean()
            per_area *= np.interp(distance, view.clutter_ranges, view.clutter_density) / mean
        born = self.settings.births / self.radars / (view.max_range - view.min_range)
        if look.radar.rotation_s:
            born *= look.radar.rotation_s / self.settings.interval_s
        width = view.fov.width
        rate = look.radar.range_rate
        if rate is not None and look.rates is not None:
            width *= rate.clutter_width
        return per_area / width, np.full(len(distance), born / width)

    def _seen(self, look: Look) -> _Seen:
        radar, shape = look.radar, self.mean.shape[:2]
        line = self.mean[..., POSITION] - np.array(radar.position)
        velocity = self.mean[..., VELOCITY]
        distance = np.hypot(line[..., 0], line[..., 1]) + 1e-6
        along = line / distance[..., None]
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        rate, measured = radar.range_rate, 2
        noise = [radar.range_std**2, radar.azimuth_std**2]
        if rate is not None and look.rates is not None:
            measured, noise = 3, [*noise, rate.std**2]
        slope = np.zeros((*shape, measured, AXES))
        slope[..., 0, POSITION] = along
        slope[..., 1, POSITION] = across / distance[..., None]
        moved = line[..., None, :] + look.later_s[:, None] * velocity[..., None, :]
        bearing = np.arctan2(moved[..., 1], moved[..., 0]) - radar.yaw
        error = [
            look.measurement[:, 0] - np.hypot(moved[..., 0], moved[..., 1]),
            wrap_angle(look.measurement[:, 1] - bearing),
        ]
        if rate is not None and look.rates is not None:
            turning = (across * velocity).sum(-1) / distance
            slope[..., 2, VELOCITY] = along
            slope[..., 2, POSITION] = across * turning[..., None]
            error.append(rate.wrap(look.rates - (along * velocity).sum(-1)[..., None]))
        turned = np.swapaxes(slope, -1, -2)
        spread: FloatArray = slope @ self.covariance @ turned + np.diag(noise)
        if rate is not None and look.rates is not None and rate.ambiguity:
            # Where the predicted range rate is vaguer than the ambiguity, it says nothing.
            vague = np.sqrt(spread[..., 2, 2]) > rate.ambiguity / VAGUE
            spread[..., 2, 2] = np.where(vague, UNKNOWN_RATE**2, spread[..., 2, 2])
        azimuth = wrap_angle(np.arctan2(line[..., 1], line[..., 0]) - radar.yaw)
        view = np.stack([distance.ravel(), azimuth.ravel()], axis=1)
        detection: FloatArray = radar.visibility.probability(view[:, 0])
        detection = detection * radar.visibility.probability_in_view(view)
        if look.part is not None:
            inside = np.mod(view[:, 1] - look.part.start, FULL_TURN) < look.part.width
            detection = np.where(inside, detection, 0.0)
        gain: FloatArray = self.covariance @ turned @ np.linalg.inv(spread)
        return _Seen(np.stack(error, -1), spread, gain, detection.reshape(shape))

    def _associate(self, seen: _Seen, likelihood: FloatArray, other: FloatArray) -> FloatArray:
        """Update all tracks; return the probabilities that detections are no track's, (J,)."""
        chance = (self.motion * seen.detection).sum(1)
        share = self.motion[..., None] * seen.detection[..., None] * likelihood
        pair = share.sum(1)
        missed = 1.0 - self.existence * chance
        none, which, free = marginals(missed, self.existence[:, None] * pair, other)
        unseen = none * self.existence * (1.0 - chance) / missed
        self.existence = np.clip(unseen + which.sum(1), 1e-9, 1.0 - 1e-9)
        # Motions, given each detection and given none.
        known = np.where(pair > 0.0, pair, 1.0)[:, None]
        detected = (which / self.existence[:, None])[:, None] * share / known
        still = self.motion * (1.0 - seen.detection)
        still *= (unseen / self.existence / np.maximum(1.0 - chance, 1e-12))[:, None]
        total = detected.sum(2) + still
        self.motion = np.maximum(total, 1e-8)
        self.motion /= self.motion.sum(1, keepdims=True)
        self._move(seen, detected / (total + 1e-300)[..., None], still / (total + 1e-300))
        return free

    def _move(self, seen: _Seen, weight: FloatArray, none: FloatArray) -> None:
        """Match the moments of the updates with each detection and with none."""
        step = np.einsum("tmab,tmjb->tmja", seen.gain, seen.error)
        mean = np.einsum("tmj,tmja->tma", weight, step)
        less = seen.gain @ seen.spread @ np.swapaxes(seen.gain, -1, -2)
        between = np.einsum("tmj,tmja,tmjb->tmab", weight, step, step)
        between -= mean[..., :, None] * mean[..., None, :]
        self.mean = self.mean + mean
        covariance = self.covariance - (1.0 - none)[..., None, None] * less + between
        self.covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))

    def _start(self, look: Look, free: FloatArray, clutter: FloatArray, born: FloatArray) -> None:
        existence = free * born / (clutter + born)
        new = np.flatnonzero((existence > LEAST_BORN) & (free > 0.05))
        count, radar = len(new), look.radar
        distance, bearing = look.measurement[new, 0], look.measurement[new, 1] + radar.yaw
        mean, covariance = np.zeros((count, AXES)), np.zeros((count, AXES, AXES))
        axes = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        axes = np.stack([axes, np.stack([-axes[:, 1], axes[:, 0]], axis=1)], axis=2)
        mean[:, POSITION] = np.array(radar.position) + distance[:, None] * axes[:, :, 0]
        sides = np.stack([np.full(count, radar.range_std), distance * radar.azimuth_std], axis=1)
        covariance[:, [[0], [2]], POSITION] = np.einsum("jik,jk,jlk->jil", axes, sides**2, axes)
        covariance[:, VELOCITY, VELOCITY] = self.settings.velocity_std**2
        added = {
            "mean": np.repeat(mean[:, None], MOTIONS, 1),
            "covariance": np.repeat(covariance[:, None], MOTIONS, 1),
            "motion": np.tile(FIRST, (count, 1)),
            "existence": existence[new],
            "confirmed": np.zeros(count, dtype=np.bool_),
            "number": self.numbers + 1 + np.arange(count),
        }
        self.numbers += count
        for name, values in added.items():
            setattr(self, name, np.concatenate([getattr(self, name), values]))

    def _keep(self, rows: IntArray) -> None:
        for name in ("mean", "covariance", "motion", "existence", "confirmed", "number"):
            setattr(self, name, getattr(self, name)[rows])

    def _distinct(self) -> IntArray:
        """Return the rows of probable tracks without the younger one of two of one target."""
        mean, covariance = _mixed(self.motion, self.mean, self.covariance)
        kept = self.existence > LEAST
        order = np.argsort(-self.existence, kind="stable")
        likely = [i for i in order.tolist() if self.existence[i] > 0.05]
        place = mean[:, POSITION]
        for a, i in enumerate(likely):
            for j in likely[a + 1 :]:
                apart = np.abs(place[i] - place[j]) >= self.settings.near
                if not (kept[i] and kept[j]) or apart.any():
                    continue
                off = mean[i] - mean[j]
                if off @ np.linalg.solve(covariance[i] + covariance[j], off) < 1.0:
                    first = self.number[i] < self.number[j] or self.confirmed[i]
                    kept[j if first else i] = False
        return np.sort(order[kept[order]][:MOST_TRACKS])

    def smoothed(self, times: Sequence[float]) -> list[PointSet]:
        """Return the tracks at times, from their first detection on, smoothed over the lag."""
        rows: dict[float, list[tuple[int, FloatArray, FloatArray]]] = {time: [] for time in times}
        for number, history in self.history.items():
            stamps = np.array([past.time_s for past in history])
            confirmed = np.array([past.confirmed for past in history])
            existence = np.array([past.existence for past in history])
            last_of_stamp = np.append(np.diff(stamps) > 0.0, True)
            for first in np.flatnonzero(last_of_stamp).tolist():
                if history[first].time_s not in rows:
                    continue
                end = stamps[first] + self.settings.lag_s + 1e-6
                last = int(np.searchsorted(stamps, end)) - 1
                later = slice(first, last + 1)
                if confirmed[later].any() and existence[later].max() >= LEAST_SMOOTHED:
                    found = (number, *_backwards(history[later]))
                    rows[history[first].time_s].append(found)
        return [
            _points(*(np.array(column) for column in zip(*rows[time], strict=True)))
            if rows[time]
            else _points(np.zeros(0, np.int64), np.zeros((0, AXES)), np.zeros((0, AXES, AXES)))
            for time in times
        ]


def _points(number: IntArray, mean: FloatArray, covariance: FloatArray) -> PointSet:
    spread = covariance[:, POSITION][:, :, POSITION]
    nobody = np.zeros(len(number), dtype=np.int64)
    return PointSet(mean[:, POSITION], nobody, number, mean[:, VELOCITY], spread)


def _backwards(history: Sequence[_Past]) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance at the first entry, given all."""
    mean, covariance = history[-1].mean, history[-1].covariance
    for now, then in zip(history[-2::-1], history[:0:-1], strict=True):
        dt = then.time_s - now.time_s
        if dt > 0.0:
            matrix = _transition(dt, 1.0)[0]
            gain = np.linalg.solve(then.predicted[1], matrix @ now.covariance).T
            mean = now.mean + gain @ (mean - then.predicted[0])
            covariance = now.covariance + gain @ (covariance - then.predicted[1]) @ gain.T
    return mean, covariance


def _likelihood(seen: _Seen, look: Look) -> FloatArray:
    """Return the densities of detections, (T, M, J); 0 beyond the gate."""
    density, square = _density(seen.error, seen.spread)
    density = np.where(square > GATE, 0.0, density)
    rate = look.radar.range_rate
    if rate is None or look.rates is None or not rate.ambiguity:
        return density
    vague = seen.spread[..., 2, 2, None] >= UNKNOWN_RATE**2
    without, _ = _density(seen.error[..., :2], seen.spread[..., :2, :2])
    return np.where(vague, without / rate.ambiguity, density)


def _density(error: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    square = np.einsum("tmja,tmab,tmjb->tmj", error, np.linalg.inv(spread), error)
    scale = (2.0 * math.pi) ** (0.5 * error.shape[-1]) * np.sqrt(np.linalg.det(spread))
    return np.exp(-0.5 * np.minimum(square, 700.0)) / scale[..., None], square


def follow(
    scenario: Scenario,
    reports: Sequence[SimulatedReport],
    settings: Settings,
    times: Sequence[float],
) -> tuple[list[PointSet], list[PointSet]]:
    """Return the filtered and the smoothed tracks at ascending times, seconds after scan 0.

    Filtered tracks use the looks up to their time.
    """
    looks = looks_of(scenario, reports)
    begin_s = looks[0].time_s if looks else 0.0
    tracker = Tracker(settings, len(scenario.radars), min([begin_s, *times]))
    filtered, begin = [], 0
    at = np.array([look.time_s for look in looks])
    for time in times:
        end = int(np.searchsorted(at, time, side="right"))
        for look in looks[begin:end]:
            tracker.add(look.time_s, look)
        begin = end
        tracker.add(time, None)
        filtered.append(tracker.report())
    return filtered, tracker.smoothed(times)
