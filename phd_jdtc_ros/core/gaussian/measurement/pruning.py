"""Pruning of each target's hypotheses to the most probable ones."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Float1, Int1, compiled


@compiled
def most_probable(
    most: int, least_share: float, target_of: Int1, mass: Float1
) -> tuple[IntArray, FloatArray]:
    """Return the most probable hypotheses of each target in descending order of probability.

    Parameters
    ----------
    most : int
        Largest number per target.
    least_share : float
        Hypotheses with less than this share of their target's existence probability are dropped.
    target_of : int array of shape (N,)
        The target of each hypothesis; every index below the number of targets occurs.
    mass : array of shape (N,)

    Returns
    -------
    kept : int array of shape (K,)
        Rows of the kept hypotheses, sorted by target.
    factor : array of shape (K,)
        Factor on their weights that preserves the existence probability of each target.
    """
    targets = 0
    for target in target_of:
        targets = max(targets, target + 1)
    existence, size = np.zeros(targets), np.zeros(targets, np.int64)
    for row in range(len(target_of)):
        existence[target_of[row]] += mass[row]
    best, factor = np.empty((targets, most), np.int64), np.empty(targets)
    for row in range(len(target_of)):
        target = target_of[row]
        if mass[row] < least_share * existence[target] or not mass[row] > 0.0:
            continue
        # Insertion in descending order of mass; of too many, the last one is dropped.
        rank = size[target]
        while rank > 0 and mass[best[target, rank - 1]] < mass[row]:
            if rank < most:
                best[target, rank] = best[target, rank - 1]
            rank -= 1
        if rank < most:
            best[target, rank] = row
            size[target] = min(size[target] + 1, most)
    total = 0
    for target in range(targets):
        left = 0.0
        for rank in range(size[target]):
            left += mass[best[target, rank]]
        factor[target] = existence[target] / left if left > 0.0 else 1.0
        total += size[target]
    kept, by_row = np.empty(total, np.int64), np.empty(total)
    total = 0
    for target in range(targets):
        for rank in range(size[target]):
            kept[total], by_row[total] = best[target, rank], factor[target]
            total += 1
    return kept, by_row
