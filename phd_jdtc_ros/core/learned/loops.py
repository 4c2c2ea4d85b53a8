"""Compiled loops of what is learned; a module of their own, so that only engines load numba."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float1, compiled, inner


@inner
def _posterior(
    right: float, scale: float, wide: float, log_ratio: float, precision: float
) -> tuple[float, float]:
    """Return the mean and the variance of a log ratio; see `RatioPrior`."""
    # Variances of the shown log ratio relative to that of its error.
    near, far = 1.0 + precision * scale * scale, 1.0 + precision * wide * wide
    log_odds = math.log(right / (1.0 - right)) - 0.5 * math.log(near / far)
    log_odds -= 0.5 * precision * log_ratio**2 * (1.0 / near - 1.0 / far)
    share = 1.0 / (1.0 + math.exp(min(log_odds, 500.0)))
    difference = log_ratio * (1.0 / near - 1.0 / far)
    of_near, of_far = scale * scale / near, wide * wide / far
    variance = of_near + share * (of_far - of_near) + share * (1.0 - share) * difference**2
    return log_ratio * (1.0 - 1.0 / near) + share * difference, variance


@compiled
def mixture_posterior(
    right: float, scale: float, wide: float, log_ratio: Float1, precision: Float1
) -> FloatArray:
    """Return the mean and the variance of each log ratio, (2, K); see `RatioPrior`."""
    moments = np.empty((2, len(log_ratio)))
    for row in range(len(log_ratio)):
        moments[0, row], moments[1, row] = _posterior(
            right, scale, wide, log_ratio[row], precision[row]
        )
    return moments


@compiled
def detection_factors(
    right: float,
    scale: float,
    wide: float,
    prior_weight: float,
    most: float,
    probability: float,
    expected: Float1,
    detected: Float1,
) -> FloatArray:
    """Return the factors of a probability and their deviations, (2, K); see `DetectionFactor`.

    `most` is the largest probability; the last arguments are the expected and actual numbers of
    detections.
    """
    factors = np.empty((2, len(expected)))
    for row in range(len(expected)):
        shrunk = (prior_weight + detected[row]) / (prior_weight + expected[row])
        # The smaller of both probabilities has the lower precision, so that few looks prove little.
        bounded = min(probability * min(shrunk, 1.0), most)
        precision = expected[row] / probability * bounded / (1.0 - bounded)
        mean, variance = _posterior(right, scale, wide, math.log(shrunk), precision)
        factors[0, row] = math.exp(mean)
        factors[1, row] = factors[0, row] * math.sqrt(variance)
    return factors


@compiled
def evidence_of_sectors(
    learned: Float1,
    before: Float1,
    trials: Float1,
    expected: Float1,
    detected: Float1,
    remembered: Float1,
    all_remembered: float,
    changed: Float1,
    unchanged: Float1,
    known: Float1,
) -> FloatArray:
    """Return the log likelihood ratios of changes, given trials, (1 + A,); see `ChangeAlarm`.

    `learned` and `before` are the factors of each cell, now and when the evidence began, (K,).
    Trials, expected and detected numbers, and the expected numbers that are remembered, are of the
    cells too; `changed`, `unchanged` and `known` are of the sensor and its sectors, (1 + A,).
    """
    evidence, sectors = np.zeros(len(known)), len(known) - 1
    sums = np.zeros((4, len(known)))
    for cell in range(len(learned)):
        for place in (0, 1 + cell % sectors):
            factor = before[cell] if place else learned[cell]
            sums[0, place] += trials[cell]
            sums[1, place] += detected[cell]
            sums[2, place] += factor * expected[cell]
            sums[3, place] += remembered[cell]
    sums[3, 0] = all_remembered
    for place in range(len(known)):
        if sums[3, place] >= known[place]:
            count, hits = sums[0, place], sums[1, place]
            usual = min(max(sums[2, place] / (count if count > 0.0 else 1.0), 0.01), 0.99)
            of_miss = (1.0 - changed[place] * usual) / (1.0 - unchanged[place] * usual)
            evidence[place] = hits * math.log(changed[place] / unchanged[place])
            evidence[place] += (count - hits) * math.log(of_miss)
    return evidence
