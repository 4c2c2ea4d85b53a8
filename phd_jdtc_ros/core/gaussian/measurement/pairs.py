"""Weights of the pairs of hypothesis and detection, and the selection of probable pairs."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray, sum_by
from ...association.marginals import LEAST_CLUTTER
from ...models.competing_sources import CompetingSources
from ..mixture import Mixture

# A pair with less than this share of its detection's sources, or of its target's hypotheses, is
# left out before the iterated update.
LEAST_SHARE = 1e-4


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
    weight: FloatArray = mixture.weight[row] * np.exp(
        log_mass - others.log_scale[column, None, None]
    )
    return weight


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
    mass, total = sum_modes(weight), others.total
    target, count = mixture.target[row], len(mixture.label)
    odds = mass / np.maximum(total, LEAST_CLUTTER)[column]
    edge, place = np.unique(target * len(total) + column, return_inverse=True)
    own = sum_by(place.ravel(), odds, len(edge))
    wanted = sum_by(column, odds, len(total))[edge % max(len(total), 1)]
    left = own / (1.0 + np.maximum(wanted - own, 0.0))
    alone = 1.0 - mixture.existence + sum_by(mixture.target, sum_modes(missed), count)
    alone += sum_by(edge // max(len(total), 1), left, count)
    rows: IntArray = np.flatnonzero(odds > LEAST_SHARE * np.maximum(alone, 1.0)[target])
    return rows
