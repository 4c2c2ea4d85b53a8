"""Continues track numbers after scans were reprocessed with out-of-sequence reports.

A label contains the scan in which the target was born, and its index there. Labels of targets that
are older than the out-of-sequence report stay the same. Younger targets may have been born at other
detections or in other scans, and are matched by their states.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import Estimates
from .track_numbers import birth_scan

# Gate of the square Mahalanobis distance between the positions of two estimates of one target.
GATE = 16.0
# The same gate for positions with velocities.
MOVING_GATE = 20.0
# Number of nearest targets of the other set that are compared with each target; bounds the number
# of pairs of two sets of thousands.
NEIGHBOURS = 32


def match(first: Estimates, second: Estimates, moving: bool = False) -> tuple[IntArray, IntArray]:
    """Match two sets of estimates of one stamp, and return the rows of the same targets, in pairs.

    The assignment minimises the total square Mahalanobis distance of positions, and of velocities
    too if targets are `moving`, by the sum of the covariances. Pairs are within `GATE` or
    `MOVING_GATE`, and only the `NEIGHBOURS` nearest targets are candidates. Time and memory grow
    with the number of targets.
    """
    # This is imported here because only out-of-sequence reports need it, and a live node starts
    # sooner.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    if not (len(first) and len(second)):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    gate = MOVING_GATE if moving else GATE
    axes = [*first.space.position, *(first.space.velocity if moving else ())]
    rows, columns = _neighbours(first, second)
    cost = _square_distance(first, second, rows, columns, axes)
    in_gate = cost <= gate
    # A column of its own leaves a target unmatched. The sparse matrix drops weights of zero.
    unmatched = np.arange(len(first))
    # Cost of an unmatched target: above any sum of square distances within the gates, so that as
    # many targets as possible are matched.
    edge = np.concatenate([cost[in_gate], np.full(len(first), 1e6)]) + 1.0
    start = np.concatenate([rows[in_gate], unmatched])
    end = np.concatenate([columns[in_gate], len(second) + unmatched])
    # SciPy before 1.15 matches only with indices of four bytes.
    indices = start.astype(np.int32), end.astype(np.int32)
    edges = csr_array((edge, indices), shape=(len(first), len(second) + len(first)))
    row, column = min_weight_full_bipartite_matching(edges)
    pairs = column < len(second)
    return row[pairs].astype(np.int64), column[pairs].astype(np.int64)


def _neighbours(first: Estimates, second: Estimates) -> tuple[IntArray, IntArray]:
    """Return the pairs of each target of the first set with its nearest ones of the second."""
    from scipy.spatial import KDTree

    query, point = (
        # Range of the artificial third coordinate in the neighbour search, metres: without it,
        # targets at one place would share one leaf of the tree and be compared one by one.
        np.column_stack([estimates.position, np.linspace(0.0, 1e-3, len(estimates))])
        for estimates in (first, second)
    )
    count = min(NEIGHBOURS, len(second))
    nearest = KDTree(point).query(query, k=np.arange(1, count + 1))[1]
    return np.arange(len(first)).repeat(count), nearest.ravel().astype(np.int64)


def _square_distance(
    first: Estimates, second: Estimates, rows: IntArray, columns: IntArray, axes: list[int]
) -> FloatArray:
    """Return the square Mahalanobis distance of each pair."""
    difference = first.state[rows][:, axes] - second.state[columns][:, axes]
    spread = (first.covariance[rows] + second.covariance[columns])[:, axes][:, :, axes]
    # A metre, and a metre per second, of slack keep small covariances regular. The slack is lost by
    # rounding in very large ones; therefore their correlations have slack too.
    spread = spread + np.eye(len(axes))
    variance = np.einsum("pkk->pk", spread)
    if not (variance > 0.0).all():
        raise np.linalg.LinAlgError("covariance: a variance is negative, must be positive")
    scale = np.sqrt(variance)
    # Slack of correlation matrices, which single precision may have rounded to singular ones.
    correlation = spread / (scale[:, :, None] * scale[:, None]) + 2e-6 * np.eye(len(axes))
    difference = difference / scale
    squared: FloatArray = np.einsum(
        "pk,pk->p", difference, np.linalg.solve(correlation, difference[..., None])[..., 0]
    )
    return np.maximum(squared, 0.0)


def continue_numbers(
    earlier: Mapping[int, int],
    latest: Mapping[int, int],
    before: Estimates,
    after: Estimates,
    first: int,
) -> dict[int, int]:
    """Return the track numbers by label after scans were reprocessed.

    `earlier` and `latest` are the numbers by label before these scans and after their first
    processing, and `before` and `after` the estimates after the first processing and after the
    second; `track_id` is still label + 1. `first` is the index of the first reprocessed scan.
    """
    numbers = {
        label: number
        for label, number in {**earlier, **latest}.items()
        if birth_scan(np.array(label - 1)) < first
    }
    renumbered = np.array([label for label in latest if label not in numbers], dtype=np.int64)
    before_young = before.select(np.isin(before.track_id, renumbered))
    is_young = birth_scan(after.track_id - 1) >= first
    after_young = after.select(is_young & (after.track_id > 0))
    for row, column in zip(*match(before_young, after_young), strict=True):
        numbers[int(after_young.track_id[column])] = latest[int(before_young.track_id[row])]
    return numbers
