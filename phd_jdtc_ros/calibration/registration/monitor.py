"""Monitors the biases of a running tracker's radars; it changes no estimate.

A detection that is near exactly one confirmed track is compared with the track's prediction from
its last estimate. Only tracks that another radar has recently detected count, because a radar alone
would agree with itself. Each radar's mean residuals of range and azimuth are averaged with
exponential forgetting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import CONFIRMED, Detections, Estimates, Scan

# Effective number of residuals of a mean, and least number for a warning.
MEMORY, LEAST = 400, 60
# A bias is significant if the mean residual exceeds the sum of SIGMAS standard deviations of the
# mean and SHARE standard deviations of a single plot.
SIGMAS, SHARE = 5.0, 0.25
# Inflation of a mean's standard deviation: residuals of one track are correlated.
CORRELATED = 1.25
# Gate on residuals, in standard deviations. With a larger bias only few residuals are inside, near
# its edge; their mean is significant.
GATE = 6.0
# A track counts if its estimate, and its last detection by another radar, are no older than this
# many scans of the slowest radar.
MAX_AGE_SCANS = 2.5


class MeanResidual(NamedTuple):
    """Mean residuals of a radar's plots against tracks that other radars detect too."""

    radar: str
    residuals: int  # Number of residuals so far
    # Means in range and azimuth, metres and radians, (2,); NaN without residuals.
    mean: FloatArray
    sigma: FloatArray  # Standard deviations of the means, (2,)
    significant: tuple[bool, bool]  # True where each mean exceeds what noise explains


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
        sigma: FloatArray = CORRELATED * np.sqrt(self.variance * self.squared_weights)
        return sigma


class RegistrationMonitor:
    """Keeps the mean residuals of each radar; `interval_s` is the nominal interval, seconds."""

    def __init__(self, radars: Sequence[RadarModel], interval_s: float) -> None:
        self._radars = tuple(radars)
        slowest_s = max(interval_s, *(radar.rotation_s for radar in self._radars))
        self._max_age_ns = round(MAX_AGE_SCANS * slowest_s * 1e9)
        self._means = [_Mean() for _ in self._radars]
        # The confirmed tracks with a unique number, of the newest estimates.
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
        if tracks is not None and 0 < scan.stamp_ns - tracks.stamp_ns <= self._max_age_ns:
            for index, detections in enumerate(scan.detections):
                if detections is not None and len(detections) and len(tracks):
                    self._compare(index, scan.stamp_ns, detections, tracks)
        if filtered:
            newest = filtered[-1]
            confirmed = (newest.track_state == CONFIRMED) & (newest.track_id > 0)
            self._tracks = newest.take(np.flatnonzero(confirmed))
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
        limit = GATE * np.sqrt(np.diagonal(predicted, axis1=-2, axis2=-1) + variance)
        near = (np.abs(residual) < limit).all(axis=-1)
        unambiguous = near & (near.sum(axis=0) == 1) & (near.sum(axis=1) == 1)[:, None]
        for row, column in np.argwhere(unambiguous).tolist():
            seen = self._seen_ns.setdefault(int(tracks.track_id[row]), {})
            others = [last_ns for other, last_ns in seen.items() if other != index]
            seen[index] = stamp_ns
            if others and stamp_ns - max(others) <= self._max_age_ns:
                self._means[index].add(residual[row, column])

    def mean_residuals(self) -> list[MeanResidual]:
        """Return each radar's mean residuals."""
        return list(map(_mean_residual, self._radars, self._means))


def _mean_residual(radar: RadarModel, mean: _Mean) -> MeanResidual:
    if not mean.count:
        unknown = np.full(2, np.nan)
        return MeanResidual(radar.name, 0, unknown, unknown, (False, False))
    beyond = np.abs(mean.mean) > SIGMAS * mean.sigma + SHARE * radar.noise_std
    enough = mean.count >= LEAST
    flags = bool(enough and beyond[0]), bool(enough and beyond[1])
    return MeanResidual(radar.name, mean.count, mean.mean, mean.sigma, flags)
