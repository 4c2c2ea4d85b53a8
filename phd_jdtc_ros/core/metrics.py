"""Miss distances between sets of positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from .types import FloatArray, IntArray


@dataclass(frozen=True)
class Ospa:
    """An OSPA distance and its two parts, in metres.

    For order p the parts obey ``distance^p = localization^p + cardinality^p``; only for p = 1 do
    they add.
    """

    distance: float
    localization: float
    cardinality: float


def ospa(truth: FloatArray, estimate: FloatArray, cutoff: float, order: float) -> Ospa:
    """Return the optimal sub-pattern assignment distance of two sets of positions.

    Parameters
    ----------
    truth : array of shape (T, 2)
    estimate : array of shape (E, 2)
        Metres, one frame.
    cutoff : float
        c, metres: the cost of a missing or false target.
    order : float
        p, at least 1.

    Returns
    -------
    Ospa
        Zero for two empty sets; c, all of it cardinality, if one of them is empty.

    References
    ----------
    Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object
    filters", IEEE Transactions on Signal Processing 56(8), 2008.
    """
    most = max(len(truth), len(estimate))
    if most == 0:
        return Ospa(0.0, 0.0, 0.0)
    cost = np.minimum(cdist(truth, estimate), cutoff) ** order
    matched = float(cost[linear_sum_assignment(cost)].sum())
    unmatched = float(cutoff**order * abs(len(truth) - len(estimate)))
    return Ospa(
        distance=((matched + unmatched) / most) ** (1.0 / order),
        localization=(matched / most) ** (1.0 / order),
        cardinality=(unmatched / most) ** (1.0 / order),
    )


def assign(truth: FloatArray, estimate: FloatArray, cutoff: float) -> tuple[IntArray, IntArray]:
    """Return the best pairs (truth index, estimate index) by position closer than `cutoff`."""
    distance = cdist(truth, estimate)
    row, column = linear_sum_assignment(np.minimum(distance, cutoff))
    near = distance[row, column] < cutoff
    return row[near], column[near]
