"""OSPA and GOSPA: miss distances between the true and the estimated positions of a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Ospa:
    """An OSPA distance and its two parts, in metres.

    For order p the parts obey ``distance^p = localization^p + cardinality^p``; they add up for
    p = 1 only.
    """

    distance: float
    localization: float
    cardinality: float


def distances(truth: FloatArray, estimate: FloatArray) -> FloatArray:
    """Return the distance of each of T positions from each of E, shape (T, E)."""
    # This is imported here and in `_assignment`: a tracker needs only the metric names, and starts
    # faster without scipy.
    from scipy.spatial.distance import cdist

    found: FloatArray = cdist(truth, estimate)
    return found


def _assignment(cost: FloatArray) -> tuple[IntArray, IntArray]:
    from scipy.optimize import linear_sum_assignment

    row, column = linear_sum_assignment(cost)
    return row, column


def ospa(truth: FloatArray, estimate: FloatArray, cutoff: float, order: float) -> Ospa:
    """Return the optimal sub-pattern assignment distance of two sets of positions.

    The positions, (T, 2) and (E, 2), are in metres and one frame. The cutoff c, metres, is the cost
    of a missed or false target, and the order p is at least 1. The distance is zero for two empty
    sets; it is c, all of it cardinality, if only one set is empty.

    References
    ----------
    Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object
    filters", IEEE Transactions on Signal Processing 56(8), 2008.
    """
    return ospa_of_distances(distances(truth, estimate), cutoff, order)


def ospa_of_distances(distance: FloatArray, cutoff: float, order: float) -> Ospa:
    """Return the optimal sub-pattern assignment distance of two sets from their base distances.

    `distance`, (T, E), is that of each member of one set to each member of the other, metres; for
    the others see `ospa`.
    """
    fewest, most = sorted(distance.shape)
    if most == 0:
        return Ospa(0.0, 0.0, 0.0)
    cost = np.minimum(distance, cutoff) ** order
    matched = float(cost[_assignment(cost)].sum())
    unmatched = float(cutoff**order * (most - fewest))
    return Ospa(
        distance=((matched + unmatched) / most) ** (1.0 / order),
        localization=(matched / most) ** (1.0 / order),
        cardinality=(unmatched / most) ** (1.0 / order),
    )


def assign(
    truth: FloatArray, estimate: FloatArray, cutoff: float, order: float = 1.0
) -> tuple[IntArray, IntArray]:
    """Return the best pairs (truth index, estimate index) by position closer than `cutoff`.

    The positions, (T, 2) and (E, 2), and the cutoff are in metres. The assignment minimises the sum
    of the distances to the power of `order`.
    """
    distance = distances(truth, estimate)
    row, column = _assignment(np.minimum(distance, cutoff) ** order)
    near = distance[row, column] < cutoff
    return row[near], column[near]


@dataclass(frozen=True)
class Gospa:
    """A GOSPA distance in metres and its parts, for alpha = 2.

    They obey ``distance^p = localization^p + c^p / 2 * (missed + false)``.
    """

    distance: float
    localization: float  # Part of the assigned pairs, not divided by their number
    missed: int  # Number of targets without an estimate
    false: int  # Number of estimates without a target


def gospa(truth: FloatArray, estimate: FloatArray, cutoff: float, order: float) -> Gospa:
    """Return the generalised optimal sub-pattern assignment distance of two sets of positions.

    Unlike OSPA it is not divided by the number of targets, and a missed target and a false one cost
    the same near each other and far apart. The parameters are as in `ospa`, but a pair at the
    distance c costs as much as a missed and a false target.

    It is that of Proposition 1 of the reference: the best of all partial assignments, with alpha =
    2. Pairs at the cutoff or beyond count as missed and false.

    References
    ----------
    Rahmathullah, Garcia-Fernandez and Svensson, "Generalized optimal sub-pattern assignment
    metric", 20th International Conference on Information Fusion, 2017.
    """
    row, column = assign(truth, estimate, cutoff, order)
    matched = float((np.linalg.norm(truth[row] - estimate[column], axis=1) ** order).sum())
    missed, false = len(truth) - len(row), len(estimate) - len(column)
    unmatched = 0.5 * cutoff**order * (missed + false)
    return Gospa(
        distance=(matched + unmatched) ** (1.0 / order),
        localization=matched ** (1.0 / order),
        missed=missed,
        false=false,
    )
