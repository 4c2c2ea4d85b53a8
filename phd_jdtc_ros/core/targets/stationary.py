"""Probability that a target is stationary, from its velocity at even prior odds.

The velocity of a newborn target has a broad distribution, under which it is probably fast. Near
quays, however, a new detection is at least as likely to be stationary. The odds of being stationary
are therefore the odds from the velocity's density, divided by the odds at birth.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chndtr

from ..arrays import FloatArray

# Excess, in detections per revolution, at which a neighbourhood is fixed clutter with probability
# 0.5.
EVEN_EXCESS = 0.5


def probability_slower(mean: FloatArray, covariance: FloatArray, bound: float) -> FloatArray:
    """Return the probability that velocities, (..., 2), are slower than a bound above 0, in m/s.

    The covariance ellipse of a velocity, (..., 2, 2), is replaced by a circle of the same area.
    """
    area = np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    # Smallest standard deviation of a velocity, metres per second and as a share of the bound.
    variance = np.maximum(area, max(0.1, 0.05 * bound) ** 2)
    square, limit = (mean**2).sum(axis=-1) / variance, bound**2 / variance
    # Beyond ten standard deviations the probability is zero, and its series would be long.
    probability: FloatArray = chndtr(limit, 2.0, np.minimum(square, (np.sqrt(limit) + 10.0) ** 2))
    return probability


def at_even_odds(probability: FloatArray, bound: float, velocity_std: float) -> FloatArray:
    """Return probabilities of being slower than a bound, for even prior odds, elementwise.

    `probability` is under a prior velocity with standard deviation `velocity_std` along each axis.
    It is returned unchanged if newborn targets are all slower, or all faster.
    """
    prior = -math.expm1(-0.5 * (bound / velocity_std) ** 2)
    stationary, moving = probability * (1.0 - prior), (1.0 - probability) * prior
    total = stationary + moving
    return np.where(total > 0.0, stationary / np.where(total > 0.0, total, 1.0), probability)


def among_reflectors(probability: FloatArray, reflectors: FloatArray) -> FloatArray:
    """Return probabilities of being stationary beside fixed clutter, elementwise.

    `probability` is that of being stationary in a place without clutter, and `reflectors`, below 1,
    that of fixed clutter in a target's neighbourhood. The odds are divided by the probability that
    the neighbourhood has no fixed clutter. A probability of zero stays zero.
    """
    motion = (1.0 - probability) * (1.0 - reflectors)
    return probability / (probability + motion)


def among_fixed_clutter(excess: FloatArray) -> FloatArray:
    """Return the probability that a neighbourhood is fixed clutter, elementwise.

    `excess` is its number of detections per revolution beyond uniform clutter and one reflector.
    """
    return excess / (excess + EVEN_EXCESS)
