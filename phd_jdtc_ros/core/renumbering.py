# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which targets keep their track numbers when scans were stepped again with late reports.

A label says in which scan a target was born, and where in it. Those of targets that are older than
the late report stay. Younger ones may have been born at another detection, or in another scan: they
are matched by where they are.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .arrays import FloatArray, IntArray
from .origins import first_scan
from .reporting import chosen
from .types import Estimates

# Square Mahalanobis distance beyond which two estimates are not of one target: of positions, and of
# positions with velocities.
GATE, MOVING_GATE = 16.0, 20.0
# Of pairs that are no matches; larger than any that is, and finite, as the solver needs it.
_NO_MATCH = 1e6


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
        Mahalanobis distance, by the sum of the covariances, within `GATE` or `MOVING_GATE`.
    """
    # Imported here because only late reports need it, and a live node starts sooner.
    from scipy.optimize import linear_sum_assignment

    if not (len(one) and len(other)):
        none = np.zeros(0, dtype=np.int64)
        return none, none
    gate = MOVING_GATE if moving else GATE
    axes = [*one.space.position, *(one.space.velocity if moving else ())]
    cost = np.minimum(_square_distance(one, other, axes), _NO_MATCH)
    rows, columns = linear_sum_assignment(np.where(cost <= gate, cost, _NO_MATCH))
    near = cost[rows, columns] <= gate
    return rows[near], columns[near]


def _square_distance(one: Estimates, other: Estimates, axes: list[int]) -> FloatArray:
    apart = one.state[:, None, axes] - other.state[None, :, axes]
    spread = one.covariance[:, None] + other.covariance[None]
    # With a metre, and a metre per second, of slack no covariance is singular.
    spread = spread[:, :, axes][:, :, :, axes] + np.eye(len(axes))
    squared: FloatArray = np.einsum(
        "ijk,ijk->ij", apart, np.linalg.solve(spread, apart[..., None])[..., 0]
    )
    return squared


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
    old = chosen(before, np.flatnonzero(np.isin(before.track_id, given)))
    young = first_scan(after.track_id - 1) >= first
    new = chosen(after, np.flatnonzero(young & (after.track_id > 0)))
    for row, column in zip(*matched(old, new), strict=True):
        numbers[int(new.track_id[column])] = latest[int(old.track_id[row])]
    return numbers
