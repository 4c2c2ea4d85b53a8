"""Weights of the pairs of hypothesis and detection, and the selection of probable pairs."""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association.marginals import LEAST_CLUTTER
from ...compilation import Float1, Float3, Int1, compiled, contiguous
from ...models.competing_sources import CompetingSources
from ..mixture import Mixture

# A pair with less than this share of its detection's sources, or of its target's hypotheses, is
# left out before the iterated update.
LEAST_SHARE = 1e-4


@compiled
def _pair_weights(
    prior: Float3, row: Int1, column: Int1, log_mass: Float3, log_scale: Float1
) -> FloatArray:
    """Return the results of `pair_weights`."""
    modes, cells = prior.shape[1:]
    weight = np.zeros((len(row), modes, cells))
    for pair in range(len(row)):
        for mode in range(modes):
            for cell in range(cells):
                before = prior[row[pair], mode, cell]
                if before > 0.0:
                    log_likelihood = log_mass[pair, mode, cell] - log_scale[column[pair]]
                    weight[pair, mode, cell] = before * math.exp(log_likelihood)
    return weight


@compiled
def _likely(
    least_share: float,
    target: Int1,
    existence: Float1,
    row: Int1,
    column: Int1,
    mass: Float1,
    missed: Float1,
    other: Float1,
) -> IntArray:
    """Return the results of `likely`, given the mass of each pair and of each row if missed."""
    count, targets, size = len(row), len(existence), len(other)
    odds, wanted = np.empty(count), np.zeros(size)
    start = np.zeros(targets + 1, np.int64)
    for pair in range(count):
        odds[pair] = mass[pair] / max(other[column[pair]], LEAST_CLUTTER)
        wanted[column[pair]] += odds[pair]
        start[target[row[pair]] + 1] += 1
    start = np.cumsum(start)
    order, room = np.empty(count, np.int64), start.copy()
    for pair in range(count):
        one = target[row[pair]]
        order[room[one]] = pair
        room[one] += 1
    alone = 1.0 - existence
    for one in range(len(target)):
        alone[target[one]] += missed[one]
    own, counted = np.zeros(size), np.zeros(count, np.bool_)
    for one in range(targets):
        pairs = order[start[one] : start[one + 1]]
        for pair in pairs:
            own[column[pair]] += odds[pair]
        for pair in pairs:
            # Each detection counts once, by what remains of it if all other targets claim it.
            z = column[pair]
            alone[one] += own[z] / (1.0 + max(wanted[z] - own[z], 0.0))
            own[z] = 0.0
        for pair in pairs:
            counted[pair] = odds[pair] > least_share * max(alone[one], 1.0)
    return np.flatnonzero(counted)


def pair_weights(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    log_mass: FloatArray,
    others: CompetingSources,
) -> FloatArray:
    """Return p_D L_z w of pairs, relative to the scale of their detections, shape (P, R, S).

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        Hypothesis and detection of each pair.
    log_mass : array of shape (P, R, S)
        log p_D L_z.
    """
    return _pair_weights(*contiguous(mixture.weight, row, column, log_mass, others.log_scale))


def sum_modes(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and cells, (N,), three times as fast as sums of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


def likely(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    weight: FloatArray,
    missed: FloatArray,
    others: CompetingSources,
) -> IntArray:
    """Return the pairs that may exceed `LEAST_SHARE` of both their target and their detection.

    Another target may claim a detection, however probable it is for this one. So a target's share
    is computed from the part of each detection that remains if all other targets claim it.
    """
    return _likely(
        LEAST_SHARE,
        *contiguous(mixture.target, mixture.existence, row, column),
        *contiguous(sum_modes(weight), sum_modes(missed), others.total),
    )
