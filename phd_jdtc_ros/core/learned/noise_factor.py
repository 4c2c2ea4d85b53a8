"""Measurement noise of a sensor relative to the configured one, learned from innovations."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, ReadOnly, zeros_field
from ..snapshot import floats
from .prior import RatioPrior

# Number of components whose noise may be learned: the two of a position, and the range rate.
COMPONENTS = 3
# Weight of the configured variance, as a number of innovations, so that the first innovations do
# not count alone.
PRIOR_WEIGHT = 4.0
# Prior of the ratio of variances.
PRIOR = RatioPrior(0.5, 0.1, 1.4)
# Memory, as a number of innovations of targets whose predicted measurement is certain.
MEMORY = 400.0
# Weight at which the certainty is one half. Outliers are learned after the noise: learned together
# from the start, a noise twice the configured one is taken for outliers, of which a larger share
# makes the noise seem small for hundreds of detections.
CERTAIN_WEIGHT = 20.0
# Bounds of the factor of the standard deviation.
LEAST, MOST = 0.25, 4.0
# Largest weight, and weight times ratio, accepted in a snapshot; a report may add many innovations
# at once.
MAX_WEIGHT, MAX_RATIO = 1e7, 1e10


class NoiseEvidence(NamedTuple):
    """Evidence on the variance of each component, arrays of shape (`COMPONENTS`,).

    The components are those of a measurement, and the range rate.
    """

    # Effective number of innovations: that number would show the variance equally well if they had
    # no error but the sensor's noise.
    weight: FloatArray
    # Sum of weight times the relative difference of the variance from the sensor's present one; see
    # `evidence.evidence_of`.
    excess: FloatArray
    # Mean ratio of variances that the innovations would show at the present variance; larger than 1
    # if outliers are among them.
    expected: FloatArray | float = 1.0
    # The same of all innovations, whichever are outliers; None for a sensor without any.
    with_outliers: NoiseEvidence | None = None


@dataclass(frozen=True, eq=False)
class NoiseFactor(ReadOnly):
    """Variances of the components of a measurement, and of range rates, relative to the given ones.

    The log of a variance that n innovations show has the precision n / 2; see `RatioPrior`.
    """

    # Components whose noise is learned, (Z,); the factors of the others are 1.
    learned: BoolArray = field(default_factory=lambda: np.ones(COMPONENTS, dtype=np.bool_))
    # Number of remembered innovations, (Z,).
    weight: Annotated[FloatArray, floats("Z", 0.0, MAX_WEIGHT)] = zeros_field(COMPONENTS)
    # Sum over them of weight times the ratio of variances that each shows, (Z,).
    ratio: Annotated[FloatArray, floats("Z", -MAX_RATIO, MAX_RATIO)] = zeros_field(COMPONENTS)

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Factors of variances and of deviations, and variances of the logs of the former, (Z,)."""
        shrunk = (PRIOR_WEIGHT + self.ratio) / (PRIOR_WEIGHT + self.weight)
        log_ratio = np.log(np.minimum(np.maximum(shrunk, LEAST**2), MOST**2))
        mean, variance = PRIOR.posterior(log_ratio, 0.5 * self.weight)
        factor = np.exp(mean)
        return factor, np.sqrt(factor), variance

    @property
    def variance(self) -> FloatArray:
        """Factor of each variance, shape (Z,)."""
        return self._factors[0]

    @property
    def of_std(self) -> FloatArray:
        """Factor of each standard deviation, shape (Z,)."""
        return self._factors[1]

    @property
    def certainty(self) -> float:
        """Certainty of the factors of a position's noise, 0 to 1; 1 if they are not learned."""
        weight = self.weight[:-1][self.learned[:-1]].min(initial=np.inf)
        return 1.0 if weight == np.inf else float(weight**2 / (weight**2 + CERTAIN_WEIGHT**2))

    @property
    def error(self) -> FloatArray:
        """Standard deviation of `of_std`, shape (Z,)."""
        _, of_std, variance = self._factors
        error: FloatArray = 0.5 * of_std * np.sqrt(variance)
        return error

    def after(self, evidence: NoiseEvidence) -> NoiseFactor:
        """Return the factors after the innovations of a further report."""
        retention = np.exp(-evidence.weight / MEMORY)
        ratio = self.variance * (evidence.weight + evidence.excess)
        return self.changed(
            weight=np.where(self.learned, retention * self.weight + evidence.weight, 0.0),
            ratio=np.where(self.learned, retention * self.ratio + ratio, 0.0),
        )
