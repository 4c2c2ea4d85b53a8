"""Weights of pairs of a hypothesis and a detection, and which of them count."""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray, IntArray
from ...association.marginals import LEAST_CLUTTER
from ...compilation import Float1, Float3, Int1, compiled, contiguous
from ...models.competing_sources import OtherSources
from ..mixture import Mixture

# Of the sources of a detection, and of the hypotheses of a target; pairs below it are left out
# before they are located.
LEAST_SHARE = 1e-4


@compiled
def _weighed(
    prior: Float3, row: Int1, column: Int1, log_mass: Float3, log_scale: Float1
) -> FloatArray:
    """Return the results of `weighed`."""
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
            # Each detection once: what others would leave of it if all that want it did get it.
            z = column[pair]
            alone[one] += own[z] / (1.0 + max(wanted[z] - own[z], 0.0))
            own[z] = 0.0
        for pair in pairs:
            counted[pair] = odds[pair] > least_share * max(alone[one], 1.0)
    return np.flatnonzero(counted)


def weighed(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    log_mass: FloatArray,
    others: OtherSources,
) -> FloatArray:
    """Return p_D L_z w of pairs, divided by the scale of their detections, shape (P, R, S).

    Parameters
    ----------
    mixture : Mixture
    row, column : int arrays of shape (P,)
        Hypothesis and detection of each pair.
    log_mass : array of shape (P, R, S)
        log p_D L_z.
    others : OtherSources
    """
    return _weighed(*contiguous(mixture.weight, row, column, log_mass, others.log_scale))


def summed(weight: FloatArray) -> FloatArray:
    """Return the sums over modes and cells, (N,); three times as fast as those of short axes."""
    total: FloatArray = np.einsum("hrs->h", weight)
    return total


def likely(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    weight: FloatArray,
    missed: FloatArray,
    others: OtherSources,
) -> IntArray:
    """Return the pairs that may be more than `LEAST_SHARE` of their target and their detection.

    Another target may claim a detection, however sure this target is of it. Of every detection only
    that part counts which others would leave even if all that want it did get it.
    """
    return _likely(
        LEAST_SHARE,
        *contiguous(mixture.target, mixture.existence, row, column),
        *contiguous(summed(weight), summed(missed), others.total),
    )
