"""Learned ratio of a sensor's detection probability to the configured one, by place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly, zeros_field
from ..snapshot import floats
from .prior import RatioPrior

# Number of cells in range, in equal parts of the largest range, and in azimuth.
RANGES, AZIMUTHS = 8, 8
CELLS = RANGES * AZIMUTHS
# Weight of the configured probability, in expected detections, so that the first looks alone do not
# determine the factor.
PRIOR_WEIGHT = 4.0
# Priors of the sensor's probability relative to the configured one, and of a cell's relative to the
# sensor's. That of cells is stricter, because some of many cells differ by chance, and a
# probability that is a little too high doubles the evidence of a miss.
SENSOR_PRIOR = RatioPrior(0.5, 0.02, 0.5)
CELL_PRIOR = RatioPrior(0.9, 0.01, 0.5)
# Memory, in expected detections: of the sensor's mean, and of each cell.
MEMORY = 1000.0
# Bounds of the learned probability: at 1, a target would be deleted at its first miss.
LEAST_PROBABILITY, MOST_PROBABILITY = 0.02, 0.995
# Largest number of remembered detections accepted in a snapshot; a report may add many at once.
MAX_REMEMBERED = 1e7


class TrialSums(NamedTuple):
    """Sums over the trials that count, by cell, arrays of shape (K,)."""

    trials: FloatArray  # Number of trials
    expected: FloatArray  # Number of detections expected with the configured probability
    detected: FloatArray  # Number of detections


@dataclass(frozen=True, eq=False)
class DetectionFactor(ReadOnly):
    """Expected and actual detections of known targets, as remembered by cell.

    The true probability is the configured one times a factor. h detections where e were expected
    show the factor (k + h) / (k + e), with k = `PRIOR_WEIGHT`: for a constant probability this is
    the mean of a Beta distribution, scaled. Its log has the precision n p / (1 - p) after n looks
    at targets that are detected with probability p; see `RatioPrior`. A cell's factor is learned in
    the same way relative to the sensor's. All counts fade with exp(-e / MEMORY).
    """

    max_range: float  # Largest range, metres
    # Number of detections in each cell that the configured probability predicts, (K,).
    expected: Annotated[FloatArray, floats("K", 0.0, MAX_REMEMBERED)] = zeros_field(CELLS)
    # Actual number of detections in each cell, (K,).
    detected: Annotated[FloatArray, floats("K", 0.0, MAX_REMEMBERED)] = zeros_field(CELLS)
    # Looks at targets, and expected and actual detections, in all cells. These sums have a memory
    # of their own.
    all_looks: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0
    all_expected: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0
    all_detected: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0

    @cached_property
    def _factors(self) -> tuple[float, float, FloatArray]:
        """Factor of the sensor as a whole, its deviation, and the factor of each cell."""
        from .loops import detection_factors

        assumed = self.configured if self.all_looks else MOST_PROBABILITY
        priors = *SENSOR_PRIOR, *CELL_PRIOR, PRIOR_WEIGHT, MOST_PROBABILITY
        totals = assumed, self.all_expected, self.all_detected
        return detection_factors(*priors, *totals, self.expected, self.detected)

    @property
    def mean(self) -> float:
        """Factor of the sensor as a whole."""
        return self._factors[0]

    @property
    def std(self) -> float:
        """Standard deviation of `mean`."""
        return self._factors[1]

    @property
    def configured(self) -> float:
        """Mean of the configured probability over the looks; NaN without any."""
        return self.all_expected / self.all_looks if self.all_looks else math.nan

    @property
    def by_cell(self) -> FloatArray:
        """Factor of each cell, shape (K,)."""
        return self._factors[2]

    def cell(self, measured: FloatArray) -> IntArray:
        """Return the cells of (range, azimuth) rows, (N, 2) to (N,); ranges may be infinite."""
        ring = np.minimum(measured[:, 0] * (RANGES / self.max_range), RANGES - 1.0)
        turn = np.mod(measured[:, 1] * (AZIMUTHS / (2.0 * np.pi)), AZIMUTHS)
        sector = np.minimum(turn.astype(np.int64), AZIMUTHS - 1)
        cells: IntArray = ring.astype(np.int64) * AZIMUTHS + sector
        return cells

    def probability(self, configured: FloatArray, measured: FloatArray) -> FloatArray:
        """Return the learned probabilities, given the configured ones, both (..., N).

        `measured` has range and azimuth of each of the N places, (N, 2).
        """
        factor = self.by_cell.take(self.cell(measured))
        found = np.maximum(configured * factor, LEAST_PROBABILITY)
        probability: FloatArray = np.minimum(found, MOST_PROBABILITY)
        return probability

    def after(self, sums: TrialSums) -> DetectionFactor:
        """Return the factor after further trials."""
        trials, expected, detected = np.add.reduce(np.array(sums), axis=1).tolist()
        retention, fading = np.exp(-sums.expected / MEMORY), math.exp(-expected / MEMORY)
        return self.changed(
            expected=retention * self.expected + sums.expected,
            detected=retention * self.detected + sums.detected,
            all_looks=fading * self.all_looks + trials,
            all_expected=fading * self.all_expected + expected,
            all_detected=fading * self.all_detected + detected,
        )
