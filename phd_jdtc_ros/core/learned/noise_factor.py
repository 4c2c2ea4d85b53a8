"""Measurement noise of a sensor relative to the configured one, learned from innovations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from scipy.special import chdtr

from ..arrays import BoolArray, FloatArray, read_only
from ..compilation import inner
from ..snapshot import floats
from .prior import combine

# Weight of the configured variance, as a number of innovations, that keeps the first ones from
# counting alone.
PRIOR_WEIGHT = 4.0
# Scale of the prior of the log ratio of variances.
PRIOR_SCALE = 0.1
# Memory, as a number of innovations of targets whose predicted measurement is certain.
MEMORY = 400.0
# Bounds of the factor of the standard deviation.
LEAST, MOST = 0.25, 4.0
# Innovations count as at most this many standard deviations, so that outliers do not raise it.
MOST_SIGMA = 3.0
# Innovations with a smaller share of the sensor's noise in their variance do not count: they would
# show the motion's errors.
LEAST_NOISE_SHARE = 0.25
# Mean of the squares of normal variables that are limited in this way.
LIMIT = MOST_SIGMA**2
LIMITED_MEAN = float(chdtr(3.0, LIMIT) + LIMIT * (1.0 - chdtr(1.0, LIMIT)))
# Largest weight accepted in a snapshot; a report may add many innovations at once.
MAX_WEIGHT = 1e7


class NoiseEvidence(NamedTuple):
    """Evidence on the variance of each component of a measurement, arrays of shape (Z,).

    Parameters
    ----------
    weight : array
        Number of innovations that would show the variance as well, if nothing but the sensor's
        noise were in them.
    excess : array
        Sum of weight times the relative difference of the variance from the one that the sensor
        has now; see `evidence_of`.
    """

    weight: FloatArray
    excess: FloatArray


def _every() -> BoolArray:
    return np.ones(2, dtype=np.bool_)


def _nothing() -> FloatArray:
    return np.zeros(2)


@dataclass(frozen=True, eq=False)
class NoiseFactor:
    """Variances of the components of a measurement relative to the configured ones.

    Parameters
    ----------
    learned : bool array of shape (Z,)
        Components whose noise is learned; the factors of the others are 1.
    weight : array of shape (Z,)
        Number of remembered innovations.
    ratio : array of shape (Z,)
        Sum of weight times the ratio that each of them shows.

    Notes
    -----
    The log of a variance that n innovations show has the precision n / 2; see `prior.combine`.
    """

    learned: BoolArray = field(default_factory=_every)
    weight: Annotated[FloatArray, floats("Z", 0.0, MAX_WEIGHT)] = field(default_factory=_nothing)
    ratio: Annotated[FloatArray, floats("Z", -MAX_WEIGHT, MAX_WEIGHT * MOST**2 * LIMIT)] = field(
        default_factory=_nothing
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "learned", read_only(self.learned, np.bool_))
        object.__setattr__(self, "weight", read_only(self.weight))
        object.__setattr__(self, "ratio", read_only(self.ratio))

    @cached_property
    def _posterior(self) -> tuple[FloatArray, FloatArray]:
        """Mean and precision of the log of each ratio of variances, shapes (Z,)."""
        shown = (PRIOR_WEIGHT + self.ratio) / (PRIOR_WEIGHT + self.weight)
        log_ratio = np.log(np.clip(shown, LEAST**2, MOST**2))
        return combine(log_ratio, 0.5 * self.weight, PRIOR_SCALE)

    @property
    def variance(self) -> FloatArray:
        """Factor of each variance, shape (Z,)."""
        factor: FloatArray = np.exp(self._posterior[0])
        return factor

    @property
    def of_std(self) -> FloatArray:
        """Factor of each standard deviation, shape (Z,)."""
        return np.sqrt(self.variance)

    @property
    def error(self) -> FloatArray:
        """Standard deviation of `of_std`, shape (Z,)."""
        error: FloatArray = 0.5 * self.of_std / np.sqrt(self._posterior[1])
        return error

    def after(self, evidence: NoiseEvidence) -> NoiseFactor:
        """Return the factors after the innovations of a further report."""
        kept = np.exp(-evidence.weight / MEMORY)
        ratio = self.variance * (evidence.weight + evidence.excess)
        return replace(
            self,
            weight=np.where(self.learned, kept * self.weight + evidence.weight, 0.0),
            ratio=np.where(self.learned, kept * self.ratio + ratio, 0.0),
        )


@inner
def evidence_of(square: float, part: float) -> tuple[float, float]:
    """Return the weight of an innovation, and weight times the ratio of variances beyond 1.

    Parameters
    ----------
    square : float
        Square of a component of an innovation relative to its expected value.
    part : float
        Part that the sensor's own variance R has in the expected value; NaN if the noise is not
        the sensor's own.

    Notes
    -----
    In one dimension the innovation v has the variance S = H P H' + R; `square` is v^2 / S, and
    `part` is R / S. v^2 - H P H' has the mean R, whichever R was assumed. Its variance is 2 S^2, so
    that its weight is the square of `part`. In more dimensions w = S^-1 v has the variances
    (S^-1)_ii; `square` is w_i^2 / (S^-1)_ii, and `part` is R_ii (S^-1)_ii.

    References
    ----------
    Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Transactions on
    Automatic Control 15(2), 1970.
    """
    if part > LEAST_NOISE_SHARE:  # False for NaN
        return part * part, part * (min(square, LIMIT) / LIMITED_MEAN - 1.0)
    return 0.0, 0.0
