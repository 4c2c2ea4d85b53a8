"""Which targets keep their track numbers when scans were stepped again with late reports.

A label says in which scan a target was born, and where in it. Those of targets that are older than
the late report stay. Younger ones may have been born at another detection, or in another scan: they
are matched by where they are.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import Estimates
from .labels import first_scan

# Square Mahalanobis distance beyond which two estimates are not of one target: of positions, and of
# positions with velocities.
GATE, MOVING_GATE = 16.0, 20.0
# What leaving out a target costs: more than any sum of square distances within the gates, so that
# as many are matched as can be.
_NO_MATCH = 1e6
# So many targets of the other set, the nearest, are compared with each: two sets of thousands would
# else have millions of pairs.
NEIGHBOURS = 32
# By what targets at one place are told apart in the search of neighbours, metres: without it all of
# them would be in one leaf of its tree, and compared one by one.
_SPREAD = 1e-3
# Added to correlations, so that none is singular by the rounding of single precision.
_LEAST_EIGENVALUE = 2e-6


def matched(one: Estimates, other: Estimates, moving: bool = False) -> tuple[IntArray, IntArray]:
    """Return the rows of two sets of estimates of one stamp that are of the same targets.

    Parameters
    ----------
    one, other : Estimates
    moving : bool
        Whether velocities are compared too.

    Returns
    -------
    tuple of two int arrays
        Rows of the first and of the second, pair by pair. The pairs are those of least total square
        Mahalanobis distance, by the sum of the covariances, within `GATE` or `MOVING_GATE`, of each
        target with its `NEIGHBOURS` nearest. Time and memory grow with the number of targets.
    """
    # Imported here because only late reports need it, and a live node starts sooner.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    if not (len(one) and len(other)):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    gate = MOVING_GATE if moving else GATE
    axes = [*one.space.position, *(one.space.velocity if moving else ())]
    rows, columns = _neighbours(one, other)
    cost = _square_distance(one, other, rows, columns, axes)
    near = cost <= gate
    # A target may also go with a column of its own, that is with none. Weights of 0 would be none.
    own = np.arange(len(one))
    edge = np.concatenate([cost[near], np.full(len(one), _NO_MATCH)]) + 1.0
    at = np.concatenate([rows[near], own]), np.concatenate([columns[near], len(other) + own])
    edges = csr_array((edge, at), shape=(len(one), len(other) + len(one)))
    row, column = min_weight_full_bipartite_matching(edges)
    pairs = column < len(other)
    return row[pairs].astype(np.int64), column[pairs].astype(np.int64)


def _neighbours(one: Estimates, other: Estimates) -> tuple[IntArray, IntArray]:
    """Return each target of the first set with its nearest ones of the second, pair by pair."""
    from scipy.spatial import KDTree

    query, point = (
        np.column_stack([own.position, np.linspace(0.0, _SPREAD, len(own))]) for own in (one, other)
    )
    count = min(NEIGHBOURS, len(other))
    found = KDTree(point).query(query, k=np.arange(1, count + 1))[1]
    return np.arange(len(one)).repeat(count), found.ravel().astype(np.int64)


def _square_distance(
    one: Estimates, other: Estimates, rows: IntArray, columns: IntArray, axes: list[int]
) -> FloatArray:
    """Return the square Mahalanobis distance of each pair."""
    apart = one.state[rows][:, axes] - other.state[columns][:, axes]
    spread = (one.covariance[rows] + other.covariance[columns])[:, axes][:, :, axes]
    # With a metre, and a metre per second, of slack no small covariance is singular; large ones may
    # be so wide that the slack is lost in them, and their correlations have some too.
    spread = spread + np.eye(len(axes))
    variance = np.einsum("pkk->pk", spread)
    if not (variance > 0.0).all():
        raise np.linalg.LinAlgError("covariance: a variance is negative, must be positive")
    scale = np.sqrt(variance)
    correlation = spread / (scale[:, :, None] * scale[:, None]) + _LEAST_EIGENVALUE * np.eye(
        len(axes)
    )
    apart = apart / scale
    squared: FloatArray = np.einsum(
        "pk,pk->p", apart, np.linalg.solve(correlation, apart[..., None])[..., 0]
    )
    return np.maximum(squared, 0.0)


def continued(
    earlier: Mapping[int, int],
    latest: Mapping[int, int],
    before: Estimates,
    after: Estimates,
    first: int,
) -> dict[int, int]:
    """Return the track numbers by label after scans were stepped again.

    Parameters
    ----------
    earlier, latest : mappings of label to number
        Before those scans, and after them as they were stepped the first time.
    before, after : Estimates
        After them, as they were stepped the first time and now; their tracks are labels.
    first : int
        Index of the first of those scans.
    """
    numbers = {
        label: number
        for label, number in {**earlier, **latest}.items()
        if first_scan(np.array(label - 1)) < first
    }
    given = np.array([label for label in latest if label not in numbers], dtype=np.int64)
    old = before.take(np.flatnonzero(np.isin(before.track_id, given)))
    young = first_scan(after.track_id - 1) >= first
    new = after.take(np.flatnonzero(young & (after.track_id > 0)))
    for row, column in zip(*matched(old, new), strict=True):
        numbers[int(new.track_id[column])] = latest[int(old.track_id[row])]
    return numbers
