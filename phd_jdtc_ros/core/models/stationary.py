"""Probability that a target is stationary, from its velocity at even prior odds.

The velocity of a newborn target has a broad distribution, under which it is probably fast. Near
quays, however, a new detection is at least as likely to be stationary. The odds of being stationary
are therefore the odds from the velocity's density, divided by the odds at birth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chndtr

from ..arrays import FloatArray
from ..sensors.sensor import Sensor

# Smallest standard deviation of a velocity, metres per second.
MIN_SPEED_STD = 0.1
# Smallest standard deviation of a velocity, as a share of the bound.
MIN_SPEED_STD_SHARE = 0.05


def probability_slower(mean: FloatArray, covariance: FloatArray, bound: float) -> FloatArray:
    """Return the probability that velocities, (..., 2), are slower than a bound above 0, in m/s.

    The covariance ellipse of a velocity, (..., 2, 2), is replaced by a circle of the same area.
    """
    area = np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    variance = np.maximum(area, max(MIN_SPEED_STD, MIN_SPEED_STD_SHARE * bound) ** 2)
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


def stationary_speed(radars: Sequence[Sensor]) -> float:
    """Return the speed below which a target is clutter to every radar, m/s; 0 if there is none.

    To a radar without a map of clutter, or whose `clutter_map_speed` is 0, no target is clutter.
    """
    bounds = [0.0 if radar.clutter_map is None else radar.clutter_map_speed for radar in radars]
    return min(bounds, default=0.0)
