"""Checks the configured noise by detections alone, and by innovations where tracks break.

An innovation has the errors of the prediction too, and motion models that allow for manoeuvres are
too wide for targets that fly straight: small innovations do not show that the noise is too large,
nor large ones that it is too small. So the noise is compared with the third differences of four
detections of a track in succession, which a constant acceleration does not change. Medians of their
squares are robust against turns, and against clutter beside a miss.

If the configured noise is much too small, tracks break, because the gates shrink with it and the
detections lie outside: there are few such differences. So a detection belongs to a track if it is
by far the nearest one, at any distance, and where most tracks break the innovations are compared
with the noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.factors.noise import MOST, Noise
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.sensor import Sensor

from .comparison import Compared

# Number of innovations, and of differences, of a median.
MEMORY = 400
# Largest number of tracks that are compared with a radar's detections of a scan, drawn at random.
# Medians of `MEMORY` innovations need no more.
SAMPLE = 50
# Number of detections of a difference. The next one begins with the last two of them: the squares
# of the two are nearly independent, with a correlation of 0.09.
PLOTS, KEPT = 4, 2
# Median of the chi-square distribution with one degree of freedom, and the standard deviation of
# the logarithm of the root of such a median of n independent squares, times the root of n.
ONE, ERROR = 0.4549, 1.17
# The noise is wrong if its deviation is off by more than this factor, surely, by so many standard
# deviations, and until it is not off by more than the factor.
WRONG, SURE = 1.4, 2.5
# Tracks break if at least so many have ended, and ends are this share of ends and differences: then
# few live for four detections. The noise is the cause if most innovations exceed it so many times.
LEAST_BROKEN, BROKEN, FAR = 6, 0.6, 5.0


class Fit(NamedTuple):
    """Comparison of a radar's configured noise with its detections of tracks."""

    radar: str
    components: tuple[str, ...]  # Names of the components
    innovations: int  # Number of innovations, at most `MEMORY`
    # Ratio of the innovations of each component to the noise, as standard deviations, (2,).
    axes: FloatArray
    # Ratio of the noise of each component to the configured one, as standard deviations, (2,).
    noise: FloatArray
    # Whether the configured noise of each component is surely too small, or too large, (2,).
    too_small: BoolArray
    too_large: BoolArray


class _Memory:
    """What is remembered of a radar's detections of tracks."""

    def __init__(self) -> None:
        self.innovations: deque[FloatArray] = deque(maxlen=MEMORY)  # Squares relative to the noise
        self.differences: deque[FloatArray] = deque(maxlen=MEMORY)  # The same of differences
        self.ends: deque[bool] = deque(maxlen=MEMORY)  # True for an end, False for a difference
        # By track number the detections that wait for a difference. Each has time, position and
        # its covariance xx, xy, yy, and the measurement.
        self.paths: dict[int, list[list[float]]] = {}

    def follow(self, numbers: IntArray, rows: FloatArray) -> FloatArray:
        """Add the detections of tracks; return those of complete differences, (Q, 4, 8)."""
        complete = []
        for number, row in zip(numbers.tolist(), rows.tolist(), strict=True):
            path = self.paths.setdefault(number, [])
            if path and row[0] <= path[-1][0]:
                path.clear()
            path.append(row)
            if len(path) == PLOTS:
                complete.append(path[:])
                self.ends.append(False)
                del path[:-KEPT]
        return np.array(complete).reshape(-1, PLOTS, rows.shape[1])

    def drop_ended(self, least_s: float) -> None:
        """Drop the tracks whose last detection is older than a time."""
        for number in [n for n, path in self.paths.items() if path[-1][0] < least_s]:
            del self.paths[number]
            self.ends.append(True)

    @property
    def tracks_break(self) -> bool:
        """Whether few tracks live for a difference."""
        return sum(self.ends) >= max(LEAST_BROKEN, BROKEN * len(self.ends))


class InnovationMonitor:
    """Compares the noise with each radar's detections; see `comparison.Monitor`."""

    def __init__(self, model: TrackerModel) -> None:
        self._memories = [_Memory() for _ in model.radars]
        unknown, no = np.full(2, np.nan), np.zeros(2, dtype=np.bool_)
        self._fits = [
            Fit(radar.name, radar.components[:2], 0, unknown, unknown, no, no)
            for radar in model.radars
        ]
        self._rng = np.random.default_rng(0)
        self.model = model

    def retune(self, model: TrackerModel) -> None:
        """Use another model of the same structure from the next scan on."""
        self.model = model

    def _learned(self, radar: Sensor) -> BoolArray:
        """Return which components of a radar's position have a learned noise, (2,)."""
        factors = self.model.factors.get(radar.name, ())
        found = [factor.learned[:2] for factor in factors if isinstance(factor, Noise)]
        return found[0] if found else np.zeros(2, dtype=np.bool_)

    def forget_tracks(self) -> None:
        """Begin a new run; the innovations and differences stay."""
        for memory in self._memories:
            memory.paths.clear()

    def add(self, compared: Compared) -> None:
        """Add the squares of a report's innovations and differences to the memory."""
        memory, radar, found = (
            self._memories[compared.sensor_index],
            compared.sensor,
            compared.detections,
        )
        tracks, since_s = compared.tracks, compared.since_s
        (passed,) = (compared.covered > 0.5).nonzero()
        if len(passed) > SAMPLE:
            # Those that are followed already come first, because a difference takes several looks.
            followed = np.isin(tracks.track_id[passed], [*memory.paths])
            order = np.lexsort((self._rng.random(len(passed)), ~followed))
            passed = passed[order[:SAMPLE]]
        plots = radar.in_plane(found)
        world = plots.position[:, :2]
        row, column = _pairs(tracks.position + since_s * tracks.velocity, world, passed)
        if not len(row):
            return
        time_s = np.zeros(len(row)) if found.time_s is None else found.time_s[column]
        after_s = np.maximum(since_s + time_s, 0.0)
        position = tracks.position[row] + after_s[:, None] * tracks.velocity[row]
        measured = found.measurement[column]
        innovation = radar.wrap(measured - radar.linearise(position)[0])
        memory.innovations.extend(innovation**2 / radar.noise_std_of(found)[column] ** 2)
        covariance = plots.covariance[column]
        flat = covariance[:, (0, 0, 1), (0, 1, 1)]
        now_s = tracks.stamp_ns * 1e-9 + since_s
        rows = np.column_stack([now_s + time_s, world[column], flat, measured])
        memory.drop_ended(now_s - compared.max_age_s)
        paths = memory.follow(tracks.track_id[row], rows)
        if len(paths):
            _, slope = radar.linearise(paths[:, -1, 1:3])
            memory.differences.extend(squares_of_differences(paths, slope))

    def fits(self) -> list[Fit]:
        """Return the comparison of each radar's detections with its noise."""
        self._fits = [
            _fit(radar, memory, before, self._learned(radar))
            for radar, memory, before in zip(
                self.model.radars, self._memories, self._fits, strict=True
            )
        ]
        return self._fits


def _pairs(position: FloatArray, world: FloatArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return those of some tracks that have an unambiguous detection, and their detections."""
    # Factor by which a track's detection must be nearer than the next one, and than to other
    # tracks.
    apart = 3.0
    to_detections, column = _nearest_two(position[rows], world)
    clear = to_detections[:, 1] >= apart * to_detections[:, 0]
    rows, column, distance = rows[clear], column[clear], to_detections[clear, 0]
    to_tracks, _ = _nearest_two(world[column], position)
    clear = to_tracks[:, 1] >= apart * distance
    return rows[clear], column[clear]


def _nearest_two(places: FloatArray, others: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the distances of places to the nearest two of `others`, (N, 2), and the nearest one.

    The second distance is infinite if there is one only.
    """
    apart = places[:, None] - others
    distance = np.empty((len(places), len(others) + 1))
    distance[:, -1] = np.inf
    np.hypot(apart[..., 0], apart[..., 1], out=distance[:, :-1])
    nearest = distance.argmin(axis=1)
    distance.partition(1, axis=1)
    return distance[:, :2], nearest


def squares_of_differences(paths: FloatArray, slope: FloatArray) -> FloatArray:
    """Return squared third differences relative to the noise, (Q, 2); NaN where they are exact.

    They are along the components of a measurement, whose slopes by the position at the last
    detections are `slope`, (Q, 2, 2). `paths`, (Q, 4, 8), is as in `_Memory`.
    """
    apart = paths[:, :, None, 0] - paths[:, None, :, 0]
    apart[:, range(PLOTS), range(PLOTS)] = 1.0
    weight = 1.0 / apart.prod(axis=2)  # Divided differences, for any times
    difference = (weight[:, :, None] * paths[:, :, 1:3]).sum(axis=1)
    flat = (weight[:, :, None] ** 2 * paths[:, :, 3:6]).sum(axis=1)
    covariance = flat[:, [[0, 1], [1, 2]]]
    along = (slope @ difference[:, :, None])[:, :, 0]
    variance = np.einsum("qij,qjk,qik->qi", slope, covariance, slope)
    # A component that stays the same is rounded, and at a radar no azimuth has an error in metres.
    shows_none = (np.ptp(paths[:, :, 6:], axis=1) == 0.0) | (variance == 0.0)
    squares = along**2 / np.where(shows_none, np.nan, variance)
    # Smaller differences, in standard deviations of the noise, are rounding errors: the detections
    # are rounded, or are those of a track themselves, and show no noise.
    return np.where(squares < 1e-4**2, np.nan, squares)


def roots(squares: Sequence[FloatArray] | FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the roots of the medians of squares relative to 1, (2,), and their numbers, (2,)."""
    columns = np.array(squares).reshape(-1, 2).T
    known = [column[~np.isnan(column)] for column in columns]
    ratios = [math.sqrt(np.median(each) / ONE) if len(each) else math.nan for each in known]
    return np.array(ratios), np.array([len(each) for each in known])


def _uncertainty(count: FloatArray) -> FloatArray:
    """Return by how much the logarithms of the roots of medians may be off by chance."""
    error: FloatArray = SURE * ERROR / np.sqrt(np.maximum(count, 1))
    return error


def least_ratio(squares: FloatArray) -> FloatArray:
    """Return by which factors squares of differences surely exceed the noise, at least 1, (2,).

    Where they do, it is the most probable factor.
    """
    ratio, count = roots(squares)
    return np.where(np.log(ratio) > _uncertainty(count), ratio, 1.0)


def _fit(radar: Sensor, memory: _Memory, before: Fit, learned: BoolArray) -> Fit:
    """Return the comparison of a radar; its verdict depends on the one before."""
    (axes, _), (noise, count) = roots(memory.innovations), roots(memory.differences)
    sure = _uncertainty(count)
    # Learned noise follows smaller differences, and larger ones up to a limit.
    limit = math.log(WRONG) + np.where(learned, math.log(MOST), 0.0)
    with np.errstate(divide="ignore"):
        log_ratio = np.log(noise)
        log_plausible = np.log(np.maximum(noise, np.divide(radar.least_std, radar.noise_std)[:2]))
    too_small = log_ratio - np.where(before.too_small, 0.0, sure) > limit
    # With so many differences the deviation of the median counts twice where the noise seems too
    # large, because medians of few are often far too small.
    surely = sure * (1.0 + 10 / np.maximum(count, 1))
    too_large = ~learned & (log_plausible + np.where(before.too_large, 0.0, surely) < -limit)
    if memory.tracks_break:
        # The differences, if there are any, must not decide it.
        far = (axes > FAR) & ~(np.abs(log_ratio - limit) > sure)
        noise, too_small, too_large = np.where(far, axes, noise), too_small | far, too_large & ~far
    return Fit(
        radar.name, radar.components[:2], len(memory.innovations), axes, noise, too_small, too_large
    )
