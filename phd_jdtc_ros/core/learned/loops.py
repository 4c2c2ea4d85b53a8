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


@inner
def _detection_factor(
    prior: tuple[float, float, float],
    bounds: tuple[float, float],
    probability: float,
    expected: float,
    detected: float,
) -> tuple[float, float]:
    """Return the factor of a probability and its deviation; see `detection_factors`."""
    (right, scale, wide), (prior_weight, most) = prior, bounds
    shrunk = (prior_weight + detected) / (prior_weight + expected)
    # The smaller of both probabilities has the lower precision, so that few looks prove little.
    bounded = min(probability * min(shrunk, 1.0), most)
    precision = expected / probability * bounded / (1.0 - bounded)
    mean, variance = _posterior(right, scale, wide, math.log(shrunk), precision)
    factor = math.exp(mean)
    return factor, factor * math.sqrt(variance)


@compiled
def detection_factors(
    right: float,
    scale: float,
    wide: float,
    cell_right: float,
    cell_scale: float,
    cell_wide: float,
    prior_weight: float,
    most: float,
    probability: float,
    all_expected: float,
    all_detected: float,
    expected: Float1,
    detected: Float1,
) -> tuple[float, float, FloatArray]:
    """Return a sensor's factor, its deviation, and the factor of each cell, (K,).

    The first arguments are the priors of the sensor's factor and of a cell's relative to it; see
    `RatioPrior`. `most` is the largest probability. The last arguments are the expected and actual
    numbers of detections, of the sensor and of each cell; see `DetectionFactor`.
    """
    factors, bounds = np.empty(len(expected)), (prior_weight, most)
    prior, of_cell = (right, scale, wide), (cell_right, cell_scale, cell_wide)
    mean, std = _detection_factor(prior, bounds, probability, all_expected, all_detected)
    for cell in range(len(expected)):
        relative, _ = _detection_factor(
            of_cell, bounds, mean * probability, mean * expected[cell], detected[cell]
        )
        factors[cell] = mean * relative
    return mean, std, factors


@compiled
def evidence_after_trials(
    evidence: Float1,
    raised: float,
    most: float,
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
) -> tuple[FloatArray, FloatArray]:
    """Return the evidence of changes after trials, (1 + A,), and the factors before it, (K,).

    See `ChangeAlarm`: `evidence` is that before the trials, `raised` and `most` are its bounds.
    `learned` and `before` are the factors of each cell, now and when the evidence began, (K,).
    Trials, expected and detected numbers, and the expected numbers that are remembered, are of the
    cells too; `changed`, `unchanged` and `known` are of the sensor and its sectors, (1 + A,).
    """
    after, sectors = evidence.copy(), len(known) - 1
    sums, factor_before = np.zeros((4, len(known))), learned.copy()
    for cell in range(len(learned)):
        sector = 1 + cell % sectors
        if 0.0 < evidence[sector] < raised:
            factor_before[cell] = before[cell]
        for place in (0, sector):
            factor = factor_before[cell] if place else learned[cell]
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
            ratio = hits * math.log(changed[place] / unchanged[place])
            ratio += (count - hits) * math.log(of_miss)
            after[place] = min(max(evidence[place] + ratio, 0.0), most)
    return after, factor_before
