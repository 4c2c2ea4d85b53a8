"""Evidence on a sensor's noise from the innovations of Gaussians."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr

from ...arrays import FloatArray, frozen
from ...association.evidence import KNOWN_EXISTENCE, NoiseEvidence, OutlierEvidence
from ...compilation import Float1, Float2, Int1, compiled, inner
from ..algebra.kalman import Innovation
from ..algebra.range_rate import RateUpdate
from ..mixture import Hypotheses, Mixture
from .iterated_update import PairUpdate

NONE = np.zeros(0)
# Innovations are limited to this many standard deviations, so that outliers do not raise the noise.
MOST_SIGMA = 3.0
# Innovations with a smaller share of the sensor's noise in their variance do not count: they would
# show the motion's errors.
LEAST_NOISE_SHARE = 0.25
LIMIT = MOST_SIGMA**2


def limited_mean(variance: float) -> float:
    """Return the mean of the limited squares of normal variables of this variance."""
    limit = LIMIT / variance
    return float(variance * chdtr(3.0, limit) + LIMIT * (1.0 - chdtr(1.0, limit)))


LIMITED_MEAN = limited_mean(1.0)


@inner
def evidence_of(square: float, noise_share: float) -> tuple[float, float]:
    """Return the weight of an innovation, and the weight times the ratio of variances minus 1.

    `square` is the square of a component of an innovation, relative to its expected value.
    `noise_share` is the share of the sensor's variance R in the expected value; NaN if the
    detection has a noise of its own.

    In one dimension the innovation v has the variance S = H P H' + R; `square` is v^2 / S, and
    `noise_share` is R / S. v^2 - H P H' has the mean R, whichever R was assumed. Its variance is
    2 S^2, so that its weight is the square of `noise_share`. In more dimensions w = S^-1 v has the
    variances (S^-1)_ii; `square` is w_i^2 / (S^-1)_ii, and `noise_share` is R_ii (S^-1)_ii.

    References
    ----------
    Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Transactions on
    Automatic Control 15(2), 1970.
    """
    if noise_share > LEAST_NOISE_SHARE:  # False for NaN
        return noise_share * noise_share, noise_share * (min(square, LIMIT) / LIMITED_MEAN - 1.0)
    return 0.0, 0.0


def evidence_of_pairs(
    mixture: Mixture, update: PairUpdate, probability: FloatArray
) -> tuple[NoiseEvidence | None, OutlierEvidence | None]:
    """Return the evidence of pairs on the noise and on the share of outliers.

    The first is None if the noise is known, see `evidence_of`; the second for a sensor
    without outliers. Only targets that existed with `KNOWN_EXISTENCE` before the update count. A
    detection that may be an outlier counts with the probability that it is none, as far as the
    noise is known: while it is not, a large innovation may as well show that the noise is larger.
    Outliers count with the same certainty of the noise.

    Parameters
    ----------
    mixture : Mixture
        Before the update.
    probability : array of shape (P,)
        Association probability of each pair; distributed over its motion modes by their
        likelihoods.
    """
    innovation, report = update.innovation, update.report
    factor, outliers = report.noise, report.sensor.outliers
    if factor is None and outliers is None:
        return None, None
    outlier = NONE if update.outlier is None else update.outlier
    pairs = _Pairs(update.row, update.column, probability, update.log_likelihood)
    weight, excess, *found = _evidence(
        KNOWN_EXISTENCE,
        1.0 if factor is None else factor.certainty,
        mixture.hypotheses,
        frozen(pairs),
        innovation,
        np.ascontiguousarray(update.report.sensors_own_std),
        outlier,
        _rate_squares(update, mixture.sums.mode_weight.shape[1]),
    )
    if outliers is None:
        return NoiseEvidence(weight[0], excess[0]), None
    outlier_evidence = OutlierEvidence(*found)
    if factor is None:
        return None, outlier_evidence
    ratio = limited_mean(outliers.ratio**2) / LIMITED_MEAN
    # The components of a position have outliers, but not the range rate.
    has_outliers = np.arange(weight.shape[1]) < weight.shape[1] - 1
    expected = 1.0 + outliers.share * (ratio - 1.0) * has_outliers
    with_outliers = NoiseEvidence(weight[1], excess[1], expected)
    return NoiseEvidence(weight[0], excess[0], with_outliers=with_outliers), outlier_evidence


def _rate_squares(update: PairUpdate, modes: int) -> _Rates:
    """Return the evidence of range rates; none if their noise is not learned.

    A range rate updates a Gaussian after the position, so that its innovation has one dimension.
    """
    report, rate_update = update.report, update.further
    factor, rates = report.noise, report.range_rates
    if not isinstance(rate_update, RateUpdate) or rates is None:
        return frozen(_Rates(NONE, NONE))
    if factor is None or not factor.learned[-1]:
        return frozen(_Rates(NONE, NONE))
    sensor_std = report.sensors_own_rate_std(rates)[update.column].repeat(modes)
    variance = rate_update.variance
    return frozen(_Rates(rate_update.innovation**2 / variance, sensor_std**2 / variance))


class _Pairs(NamedTuple):
    """The P pairs of an update."""

    row: Int1  # Hypothesis, (P,)
    column: Int1  # Detection, (P,)
    probability: Float1  # Association probability, (P,)
    log_likelihood: Float1  # See `PairUpdate`, (P R,)


class _Rates(NamedTuple):
    """The evidence of range rates, as `evidence_of` takes it, (P R,), or empty."""

    square: Float1
    noise_share: Float1


@compiled
def _evidence(
    least_existence: float,
    certainty: float,
    mixture: Hypotheses,
    pairs: _Pairs,
    innovation: Innovation,
    std: Float2,
    outlier: Float1,
    rates: _Rates,
) -> tuple[FloatArray, FloatArray, float, float]:
    """Return weight and excess of `NoiseEvidence` without and with outliers, (2, Z) each.

    The last results are the numbers of `OutlierEvidence`. `outlier` may be empty.
    """
    existence, target, mode_weight = mixture.existence, mixture.target, mixture.mode_weight
    row, column, probability, log_likelihood = pairs
    _, weighted, inverse, _ = innovation
    rate_square, rate_part = rates
    modes = mode_weight.shape[1]
    size = weighted.shape[1]
    weight, excess = np.zeros((2, size + 1)), np.zeros((2, size + 1))
    detections, outliers = 0.0, 0.0
    share = np.empty(modes)
    for pair in range(len(row)):
        hypothesis, first = row[pair], pair * modes
        if existence[target[hypothesis]] < least_existence:
            continue
        detections += certainty * probability[pair]
        largest, total = -np.inf, 0.0
        for mode in range(modes):
            largest = max(largest, log_likelihood[first + mode])
        for mode in range(modes):
            share[mode] = 0.0
            if log_likelihood[first + mode] > -np.inf:
                relative = math.exp(log_likelihood[first + mode] - largest)
                share[mode] = mode_weight[hypothesis, mode] * relative
            total += share[mode]
        for mode in range(modes):
            if share[mode] <= 0.0:
                continue
            of_all = probability[pair] * share[mode] / total
            of_usual = of_all
            if len(outlier) > 0:
                outlying = certainty * outlier[first + mode]
                outliers += of_all * outlying
                of_usual *= 1.0 - outlying
            for axis in range(size + 1 if len(rate_part) > 0 else size):
                if axis < size:
                    expected = inverse[first + mode, axis, axis]
                    square = weighted[first + mode, axis] ** 2 / expected
                    noise_share = std[column[pair], axis] ** 2 * expected
                else:
                    square, noise_share = rate_square[first + mode], rate_part[first + mode]
                added_weight, added_excess = evidence_of(square, noise_share)
                weight[0, axis] += of_usual * added_weight
                weight[1, axis] += of_all * added_weight
                excess[0, axis] += of_usual * added_excess
                excess[1, axis] += of_all * added_excess
    return weight, excess, detections, outliers
