"""Checks the configured noise by comparing innovations with their expected size.

If the configured noise is much too small, tracks break, because the gates shrink with it and the
detections lie outside. So here a detection belongs to a track if it is by far the nearest one, at
any distance. Some of these detections are clutter beside a miss; medians of the squares are robust
against them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.targets.motion import MotionModel
from phd_jdtc_ros.core.types import Detections, Estimates, Scan

# Number of innovations of a median, and least numbers that show that the noise is too large or too
# small. If it is too small, few tracks are left, and the effect is strong.
MEMORY, MIN_FOR_TOO_LARGE, MIN_FOR_TOO_SMALL = 200, 30, 6
# Largest number of tracks that are compared with a radar's detections of a scan, drawn at random.
# Medians of `MEMORY` innovations need no more.
SAMPLE = 50
# Factor by which a track's detection must be nearer than the next one, and than to other tracks.
APART = 3.0
# Largest age of an estimate that is compared, in scans of the slowest radar.
MAX_AGE_SCANS = 2.5
# Medians of chi-square distributions with one and with two degrees of freedom.
ONE, TWO = 0.4549, 2.0 * np.log(2.0)
# The configured noise is too small if the median squared innovation exceeds ABOVE_EXPECTED times
# its expected value and ABOVE_NOISE times the noise variance, or FAR_ABOVE_NOISE times the noise
# variance (a lost and reborn track is so uncertain that any innovation is expected). It is too
# large below BELOW_EXPECTED times the expected value. In the shipped recordings the ratios to the
# expected value and to the noise are 0.4 to 1.1 and 0.7 to 3.5 (at the start up to 1.8 and 8.5)
# with the right noise. With a noise ten times too small the ratio to the noise is 60 and more; with
# one ten times too large the ratio to the expected value is at most 0.1.
ABOVE_EXPECTED, ABOVE_NOISE, FAR_ABOVE_NOISE, BELOW_EXPECTED = 1.2, 20.0, 1000.0, 0.2
# A warning ends when the square has returned to this share of its threshold.
HYSTERESIS = 0.8


class Fit(NamedTuple):
    """Comparison of a radar's innovations with the configured noise."""

    radar: str
    innovations: int  # Number of innovations, at most `MEMORY`
    # Ratio of the median squared innovation to the expected one; NaN without any.
    ratio_to_expected: float
    ratio_to_noise: float  # Ratio of the median squared innovation to that of the noise alone
    # Ratio of the innovations of each component to the noise, as standard deviations, (2,).
    axes: FloatArray
    components: tuple[str, ...]  # Names of the components
    # True if the innovations show that the configured noise is too small or too large.
    noise_too_small: bool = False
    noise_too_large: bool = False


class InnovationMonitor:
    """Stores the innovations of each radar's detections; it changes no estimate."""

    def __init__(self, model: TrackerModel) -> None:
        self._innovations: list[deque[FloatArray]] = [deque(maxlen=MEMORY) for _ in model.radars]
        self._fits = [_fit(radar, ()) for radar in model.radars]
        self._tracks: Estimates | None = None
        self._rng = np.random.default_rng(0)
        self.retune(model)

    def retune(self, model: TrackerModel) -> None:
        """Use another model of the same structure from the next scan on."""
        self._model, self._motions = model, tuple(dict.fromkeys(model.modes.motions))
        turns_s = (radar.rotation_s for radar in model.radars)
        self._max_age_s = MAX_AGE_SCANS * max(model.modes.interval_s, *turns_s)

    def forget_tracks(self) -> None:
        """Begin a new run; the innovations stay."""
        self._tracks = None

    def add_scan(self, scan: Scan, filtered: Sequence[Estimates]) -> None:
        """Compare a scan's detections with the tracks before it, and store the tracks after it."""
        tracks = self._tracks
        since_s = 0.0 if tracks is None else (scan.stamp_ns - tracks.stamp_ns) * 1e-9
        if tracks is not None and len(tracks) and 0.0 < since_s <= self._max_age_s:
            for innovations, radar, found in zip(
                self._innovations, self._model.radars, scan.detections, strict=True
            ):
                if found is not None and len(found):
                    innovations.extend(self._squares(radar.at(found.pose), found, tracks, since_s))
        if filtered:
            self._tracks = filtered[-1]

    def _squares(
        self, radar: Sensor, found: Detections, tracks: Estimates, since_s: float
    ) -> Iterator[FloatArray]:
        """Yield squared innovations relative to the expected ones, and by axis to the noise."""
        position = tracks.position + since_s * tracks.velocity
        expected, slope = radar.linearise(position)
        (passed,) = (radar.coverage_probability(expected, found.coverage) > 0.5).nonzero()
        if len(passed) > SAMPLE:
            passed = self._rng.choice(passed, SAMPLE, replace=False)
        row, column = _pairs(position, radar.to_world(found.measurement), passed)
        if not len(row):
            return
        expected, slope, after_s = expected[row], slope[row], np.full(len(row), since_s)
        if found.time_s is not None:
            after_s = np.maximum(after_s + found.time_s[column], 0.0)
            position = tracks.position[row] + after_s[:, None] * tracks.velocity[row]
            expected, slope = radar.linearise(position)
        innovation = radar.wrap(found.measurement[column] - expected)
        noise = radar.noise_covariance_of(found)[column]
        space = tracks.space
        axes = np.array([*space.position, *space.velocity])
        covariance = tracks.covariance[row[:, None, None], axes[:, None], axes]
        by_state = np.concatenate([slope, after_s[:, None, None] * slope], axis=2)
        predicted = by_state @ covariance @ by_state.swapaxes(-1, -2)
        # The tracks of a scan are predicted over about the same time.
        added = _process_noise(self._motions, float(np.add.reduce(after_s)) / len(row))
        predicted += added * (slope @ slope.swapaxes(-1, -2))
        squares = np.empty((len(row), 3))
        squares[:, 0] = _squared_distance(innovation, predicted + noise)
        squares[:, 1:] = innovation**2 / noise[:, (0, 1), (0, 1)]
        yield from squares

    def fits(self) -> list[Fit]:
        """Return the comparison of each radar's innovations with its noise."""
        self._fits = [
            _with_verdict(_fit(radar, innovations), before, radar)
            for radar, innovations, before in zip(
                self._model.radars, self._innovations, self._fits, strict=True
            )
        ]
        return self._fits


def _pairs(position: FloatArray, world: FloatArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return those of some tracks that have an unambiguous detection, and their detections."""
    to_detections, column = _nearest_two(position[rows], world)
    clear = to_detections[:, 1] >= APART * to_detections[:, 0]
    rows, column, distance = rows[clear], column[clear], to_detections[clear, 0]
    to_tracks, _ = _nearest_two(world[column], position)
    clear = to_tracks[:, 1] >= APART * distance
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


def _squared_distance(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the squared Mahalanobis distances of errors with two components, (N,)."""
    first, second, across = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    one, other = error[:, 0], error[:, 1]
    square: FloatArray = one**2 * second - 2.0 * one * other * across + other**2 * first
    return square / (first * second - across**2)


@lru_cache(maxsize=16)  # Scans are often equally far apart
def _process_noise(motions: tuple[MotionModel, ...], dt: float) -> float:
    """Return the largest variance that a motion adds to positions along an axis in `dt`."""
    axes = [motion.support.index(motion.space.position[0]) for motion in motions]
    return max(
        float(motion.noise_covariance(dt)[axis, axis])
        for motion, axis in zip(motions, axes, strict=True)
    )


def _fit(radar: Sensor, innovations: Sequence[FloatArray]) -> Fit:
    if not innovations:
        return Fit(radar.name, 0, np.nan, np.nan, np.full(2, np.nan), radar.components)
    squares = np.array(innovations)
    to_noise = float(np.median(squares[:, 1:].sum(axis=1))) / TWO
    axes = np.sqrt(np.median(squares[:, 1:], axis=0) / ONE)
    to_expected = float(np.median(squares[:, 0])) / TWO
    return Fit(radar.name, len(squares), to_expected, to_noise, axes, radar.components)


def _with_verdict(fit: Fit, before: Fit, radar: Sensor) -> Fit:
    """Return a fit with its verdict, which has hysteresis."""
    # Learned noise follows smaller innovations, and larger ones only to a limit.
    learned = radar.noise_factor is not None and bool(radar.noise_factor.learned[:2].any())
    share = HYSTERESIS if before.noise_too_small else 1.0
    to_expected, to_noise = fit.ratio_to_expected, fit.ratio_to_noise
    too_small = to_noise > share * FAR_ABOVE_NOISE
    too_small |= to_expected > share * ABOVE_EXPECTED and to_noise > share * ABOVE_NOISE
    too_large = to_expected < BELOW_EXPECTED / (HYSTERESIS if before.noise_too_large else 1.0)
    return fit._replace(
        noise_too_small=too_small and fit.innovations >= MIN_FOR_TOO_SMALL,
        noise_too_large=too_large and not learned and fit.innovations >= MIN_FOR_TOO_LARGE,
    )
