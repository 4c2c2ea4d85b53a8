"""Monitors the biases of a running tracker's radars; it changes no estimate.

A detection that is near exactly one confirmed track is compared with the track's prediction from
its last estimate. Only tracks that another radar has recently detected count, because a radar alone
would agree with itself. Each radar's mean residuals of range and azimuth are averaged with
exponential forgetting. So is the share of these tracks with a detection near: a radar with a large
bias detects its targets elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.calibration.comparison import Compared
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.types import CONFIRMED, TENTATIVE

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
    """Keeps the mean residuals of each radar; see `comparison.Monitor`.

    All sensors of the model are polar radars.
    """

    def __init__(self, model: TrackerModel) -> None:
        self.model = model
        self._means = [_Mean() for _ in model.radars]
        # Numbers of each radar's detections expected near others' tracks, and found there.
        self._looks = np.zeros((len(model.radars), 2))
        # Stamp of each radar's last detection of each track, by the track's number.
        self._seen_ns: dict[int, dict[int, int]] = {}

    def retune(self, model: TrackerModel) -> None:
        """Use another model of the same structure from the next scan on."""
        self.model = model

    def forget_tracks(self) -> None:
        """Begin a new run; the means stay."""
        self._seen_ns = {}

    def add(self, compared: Compared) -> None:
        """Compare a report with the tracks that are not tentative and have a number."""
        index, tracks = compared.sensor_index, compared.tracks
        radar, found = compared.sensor, compared.detections
        alive = set(tracks.track_id.tolist())
        self._seen_ns = {n: seen for n, seen in self._seen_ns.items() if n in alive}
        (rows,) = ((tracks.track_state != TENTATIVE) & (tracks.track_id > 0)).nonzero()
        if not len(rows):
            return
        time_s = np.zeros(len(found.measurement)) if found.time_s is None else found.time_s
        after_s = (time_s + compared.since_s)[:, None]
        # Rows are tracks, columns detections.
        position = tracks.position[rows, None] + after_s * tracks.velocity[rows, None]
        expected, slope = radar.linearise(position)
        residual = radar.wrap(found.measurement - expected)
        predicted = slope @ tracks.position_covariance[rows, None] @ slope.swapaxes(-1, -2)
        variance = np.diagonal(predicted, axis1=-2, axis2=-1) + radar.noise_std_of(found) ** 2
        # Gate on residuals, in standard deviations. With a larger bias only few residuals are
        # inside, near its edge; their mean is significant.
        limit = 6.0 * np.sqrt(variance)
        near = (np.abs(residual) < limit).all(axis=-1)
        # Clutter is often within the whole gate.
        closer = (np.abs(residual) / limit).max(axis=-1) < 0.5
        numbers = tracks.track_id[rows].tolist()
        oldest_ns = compared.stamp_ns - round(compared.max_age_s * 1e9)
        others_see = np.array([self._others_see(index, n, oldest_ns) for n in numbers])
        self._count(compared, rows[others_see], closer.any(axis=1)[others_see])
        unambiguous = near & (near.sum(axis=0) == 1) & (near.sum(axis=1) == 1)[:, None]
        for row, column in np.argwhere(unambiguous).tolist():
            if others_see[row] and tracks.track_state[rows[row]] == CONFIRMED:
                self._means[index].add(residual[row, column])
            self._seen_ns.setdefault(numbers[row], {})[index] = compared.stamp_ns

    def _others_see(self, index: int, track_id: int, oldest_ns: int) -> bool:
        """Return whether another radar has detected a track since a stamp."""
        seen = self._seen_ns.get(track_id, {})
        return any(last_ns >= oldest_ns for other, last_ns in seen.items() if other != index)

    def _count(self, compared: Compared, rows: IntArray, near: BoolArray) -> None:
        """Count the detections expected near the tracks of others, and those with one near."""
        due = compared.covered[rows]
        probability = compared.sensor.visibility.detection_probability(compared.expected[rows])
        due = due if probability is None else due * probability
        looks = np.array([due.sum(), np.count_nonzero(near & (due > 0.0))])
        own = self._looks[compared.sensor_index]
        self._looks[compared.sensor_index] = (1.0 - 1.0 / MEMORY) ** looks[0] * own + looks

    def mean_residuals(self) -> list[MeanResidual]:
        """Return each radar's mean residuals."""
        radars = polar_radars(self.model.radars)
        return list(map(_mean_residual, radars, self._means, self._looks))


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
