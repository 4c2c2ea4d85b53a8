"""Monitors the biases of a running tracker's radars; it changes no estimate.

A detection that is near exactly one confirmed track is compared with the track's prediction from
its last estimate. Only tracks that another radar has recently detected count, because a radar alone
would agree with itself. Each radar's mean residuals of range and azimuth are averaged with
exponential forgetting. So is the share of these tracks with a detection near: a radar with a large
bias detects its targets elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import CONFIRMED, TENTATIVE, Detections, Estimates, Scan

# Effective number of residuals of a mean, and least number for a warning.
MEMORY, LEAST = 400, 60
# A bias is significant if the mean residual exceeds the sum of SIGMAS standard deviations of the
# mean and SHARE standard deviations of a single plot.
SIGMAS, SHARE = 5.0, 0.25


class MeanResidual(NamedTuple):
    """Mean residuals of a radar's plots against tracks that other radars detect too."""

    radar: str
    residuals: int  # Number of residuals so far
    # Means in range and azimuth, metres and radians, (2,); NaN without residuals.
    mean: FloatArray
    sigma: FloatArray  # Standard deviations of the means, (2,)
    significant: tuple[bool, bool]  # True where each mean exceeds what noise explains
    # Share of the expected detections near tracks that others detect; NaN if it is not low.
    near: float = math.nan


@dataclass
class _Mean:
    """Exponentially weighted mean and variance of residuals of range and azimuth, both (2,)."""

    count: int = 0
    mean: FloatArray = field(default_factory=lambda: np.zeros(2))
    variance: FloatArray = field(default_factory=lambda: np.zeros(2))
    # Sum of the squared weights, which is the inverse of the effective number of residuals.
    squared_weights: float = 1.0

    def add(self, residual: FloatArray) -> None:
        self.count += 1
        share = max(1.0 / self.count, 1.0 / MEMORY)
        off = residual - self.mean
        self.mean = self.mean + share * off
        self.variance = (1.0 - share) * (self.variance + share * off**2)
        self.squared_weights = (1.0 - share) ** 2 * self.squared_weights + share**2

    @property
    def sigma(self) -> FloatArray:
        # Inflation of a mean's standard deviation: residuals of one track are correlated.
        sigma: FloatArray = 1.25 * np.sqrt(self.variance * self.squared_weights)
        return sigma


class RegistrationMonitor:
    """Keeps the mean residuals of each radar; `interval_s` is the nominal interval, seconds."""

    def __init__(self, radars: Sequence[RadarModel], interval_s: float) -> None:
        self._radars = tuple(radars)
        slowest_s = max(interval_s, *(radar.rotation_s for radar in self._radars))
        # A track counts if its estimate, and its last detection by another radar, are no older than
        # this many scans of the slowest radar.
        self._max_age_ns = round(2.5 * slowest_s * 1e9)
        self._means = [_Mean() for _ in self._radars]
        # Numbers of each radar's detections expected near others' tracks, and found there.
        self._looks = np.zeros((len(self._radars), 2))
        # The tracks, not tentative, with a unique number, of the newest estimates.
        self._tracks: Estimates | None = None
        # Stamp of each radar's last detection of each track, by the track's number.
        self._seen_ns: dict[int, dict[int, int]] = {}

    def retune(self, radars: Sequence[RadarModel]) -> None:
        """Use other models of the same radars from the next scan on."""
        self._radars = tuple(radars)

    def forget_tracks(self) -> None:
        """Begin a new run, in which numbers belong to other tracks. The means stay."""
        self._tracks, self._seen_ns = None, {}

    def add_scan(self, scan: Scan, filtered: Sequence[Estimates]) -> None:
        """Compare a scan's detections with the tracks before it, and store the tracks after it."""
        tracks = self._tracks
        if any(radar.space.vertical for radar in self._radars):
            return  # Biases are those of ranges and azimuths in the plane
        if tracks is not None and 0 < scan.stamp_ns - tracks.stamp_ns <= self._max_age_ns:
            for index, detections in enumerate(scan.detections):
                if detections is not None and len(detections) and len(tracks):
                    self._compare(index, scan.stamp_ns, detections, tracks)
        if filtered:
            newest = filtered[-1]
            known = (newest.track_state != TENTATIVE) & (newest.track_id > 0)
            self._tracks = newest.take(np.flatnonzero(known))
            alive = set(newest.track_id.tolist())
            self._seen_ns = {n: seen for n, seen in self._seen_ns.items() if n in alive}

    def _compare(
        self, index: int, stamp_ns: int, detections: Detections, tracks: Estimates
    ) -> None:
        radar = self._radars[index].at(detections.pose)
        own = detections.time_s
        time_s = np.zeros(len(detections)) if own is None else own
        since_s = time_s + (stamp_ns - tracks.stamp_ns) * 1e-9
        # Rows are tracks, columns detections.
        position = tracks.position[:, None] + since_s[:, None] * tracks.velocity[:, None]
        expected, slope = radar.linearise(position)
        residual = detections.measurement - expected
        residual[..., 1] = wrap_angle(residual[..., 1])
        variance = radar.noise_std_of(detections) ** 2
        predicted = slope @ tracks.position_covariance[:, None] @ slope.swapaxes(-1, -2)
        # Gate on residuals, in standard deviations. With a larger bias only few residuals are
        # inside, near its edge; their mean is significant.
        limit = 6.0 * np.sqrt(np.diagonal(predicted, axis1=-2, axis2=-1) + variance)
        near = (np.abs(residual) < limit).all(axis=-1)
        # Clutter is often within the whole gate.
        closer = (np.abs(residual) / limit).max(axis=-1) < 0.5
        self._count(index, tracks, stamp_ns, detections, closer.any(axis=1))
        unambiguous = near & (near.sum(axis=0) == 1) & (near.sum(axis=1) == 1)[:, None]
        for row, column in np.argwhere(unambiguous).tolist():
            seen = self._seen_ns.setdefault(int(tracks.track_id[row]), {})
            confirmed = tracks.track_state[row] == CONFIRMED
            if confirmed and self._others_see(index, int(tracks.track_id[row]), stamp_ns):
                self._means[index].add(residual[row, column])
            seen[index] = stamp_ns

    def _others_see(self, index: int, track_id: int, stamp_ns: int) -> bool:
        """Return whether another radar has recently detected a track."""
        seen = self._seen_ns.get(track_id, {})
        newest = max((last_ns for other, last_ns in seen.items() if other != index), default=None)
        return newest is not None and stamp_ns - newest <= self._max_age_ns

    def _count(
        self, index: int, tracks: Estimates, stamp_ns: int, detections: Detections, near: BoolArray
    ) -> None:
        """Count the detections expected near the tracks of others, and those with one near."""
        radar, numbers = self._radars[index].at(detections.pose), tracks.track_id.tolist()
        rows = [row for row, n in enumerate(numbers) if self._others_see(index, n, stamp_ns)]
        after_s = (stamp_ns - tracks.stamp_ns) * 1e-9
        place, _ = radar.linearise(tracks.position[rows] + after_s * tracks.velocity[rows])
        due = radar.visibility.coverage_probability(place, detections.coverage, radar.noise_std)
        probability = radar.visibility.detection_probability(place)
        due = due if probability is None else due * probability
        looks = np.array([due.sum(), np.count_nonzero(near[rows] & (due > 0.0))])
        self._looks[index] = (1.0 - 1.0 / MEMORY) ** looks[0] * self._looks[index] + looks

    def mean_residuals(self) -> list[MeanResidual]:
        """Return each radar's mean residuals."""
        return list(map(_mean_residual, self._radars, self._means, self._looks))


def _mean_residual(radar: RadarModel, mean: _Mean, looks: FloatArray) -> MeanResidual:
    # A radar does not see the tracks of others if this share of the detections expected there is
    # near.
    near = looks[1] / looks[0] if looks[0] >= LEAST and looks[1] < 0.25 * looks[0] else math.nan
    if not mean.count:
        unknown = np.full(2, np.nan)
        return MeanResidual(radar.name, 0, unknown, unknown, (False, False), near)
    beyond = np.abs(mean.mean) > SIGMAS * mean.sigma + SHARE * radar.noise_std
    enough = mean.count >= LEAST
    flags = bool(enough and beyond[0]), bool(enough and beyond[1])
    return MeanResidual(radar.name, mean.count, mean.mean, mean.sigma, flags, near)
