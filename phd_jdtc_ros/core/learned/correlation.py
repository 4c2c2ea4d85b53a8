"""Correlation of a sensor's detections of a target in consecutive looks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from ..arrays import FloatArray, ReadOnly, zeros_field
from ..snapshot import floats
from .prior import RatioPrior

# Bounds of the correlation; at 1, a target that is missed once would never be detected again.
LEAST, MOST = 0.0, 0.98
# Prior of its difference from the value that learning starts from.
PRIOR = RatioPrior(right=0.5, scale=0.02, wide=0.4)
# Weight of that value, as a number of pairs of looks, so that the first pairs do not count alone.
PRIOR_WEIGHT = 4.0
# Memory, as a number of pairs of looks.
MEMORY = 1000.0
# Largest number of remembered pairs accepted in a snapshot.
MAX_REMEMBERED = 1e7
# Number of sums over pairs of looks; see `sums_of`.
SUMS = 6


def sums_of(
    detected: FloatArray,
    detected_before: FloatArray,
    expected: FloatArray,
    expected_before: FloatArray,
) -> FloatArray:
    """Return the summands of each pair of looks, (P, B), given values of shape (P,).

    `detected` is the probability that the later look detected the target, and `expected` its
    detection probability. A summand that depends on the order of the looks is the mean of both.
    """
    return np.stack(
        [
            np.ones(len(detected)),
            detected * detected_before,
            0.5 * (detected + detected_before),
            0.5 * (expected + expected_before),
            0.5 * (detected * expected_before + detected_before * expected),
            expected * expected_before,
        ],
        axis=1,
    )


@dataclass(frozen=True, eq=False)
class Correlation(ReadOnly):
    """Correlation of the detections of a target in consecutive looks of a sensor.

    The detections of a target are a Markov chain: with the detection probability p and the
    correlation c it is detected with p + c (1 - p) after a detection and with p (1 - c) after a
    miss, so that p is its stationary mean. The correlation of pairs (x, y) with the expectations
    (p, q) is the mean of (x - f p)(y - f q) relative to that of f p (1 - f q), where the factor f
    brings the expectations to the mean of the detections. With a = p + c (1 - p) and b = p (1 - c),
    its variance is [a (1 - a) / p + b (1 - b) / (1 - p)] / n after n pairs.

    References
    ----------
    Klotz, "Statistical inference in Bernoulli trials with dependence", Annals of Statistics 1(2),
    1973.
    """

    start: float  # The correlation, or the one that learning starts from
    learned: bool  # Whether it is learned
    # Sums over the remembered pairs of looks, (B,); see `sums_of`.
    sums: Annotated[FloatArray, floats("B", 0.0, MAX_REMEMBERED)] = zeros_field(SUMS)

    @cached_property
    def value(self) -> float:
        """The correlation."""
        estimate, precision = self._estimate
        posterior, _ = PRIOR.posterior(np.array([estimate - self.start]), np.array([precision]))
        return min(max(self.start + float(posterior[0]), LEAST), MOST)

    @property
    def std(self) -> float:
        """Standard deviation of `value`, given by the pairs alone; infinite without pairs."""
        precision = self._estimate[1]
        return 1.0 / math.sqrt(precision) if precision else math.inf

    @cached_property
    def _estimate(self) -> tuple[float, float]:
        """The correlation that the pairs show, and the inverse of its variance."""
        pairs, both_detected, detected, expected, crossed, square = self.sums.tolist()
        if not self.learned or expected <= 0.0 or not 0.0 < detected < pairs:
            return self.start, 0.0
        factor = detected / expected
        covariance = both_detected - 2.0 * factor * crossed + factor**2 * square
        variance = max(detected - factor**2 * square, 1e-9)
        prior = PRIOR_WEIGHT * variance / pairs
        estimate = (covariance + self.start * prior) / (variance + prior)
        estimate = min(max(estimate, -MOST), MOST)
        # Half a detection and half a miss are added, so that pairs without one of them show little.
        mean, positive = (detected + 0.5) / (pairs + 1.0), max(estimate, 0.0)
        hit, miss = mean + positive * (1.0 - mean), mean * (1.0 - positive)
        spread = hit * (1.0 - hit) / mean + miss * (1.0 - miss) / (1.0 - mean)
        return estimate, pairs / spread

    def after(self, sums: FloatArray) -> Correlation:
        """Return the correlation after further pairs, given their sums, (B,)."""
        retention = math.exp(-float(sums[0]) / MEMORY)
        return self.changed(sums=retention * self.sums + sums)
