"""Pruning of each target's hypotheses to the most probable ones."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Float1, Int1, compiled


@compiled
def most_probable(
    most: int, least_share: float, target: Int1, mass: Float1
) -> tuple[IntArray, FloatArray]:
    """Return the most probable hypotheses of each target in descending order of probability.

    Parameters
    ----------
    most : int
        Largest number per target.
    least_share : float
        Hypotheses with less than this share of their target's existence probability are dropped.
    target : int array of shape (N,)
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
    for one in target:
        targets = max(targets, one + 1)
    existence, size = np.zeros(targets), np.zeros(targets, np.int64)
    for row in range(len(target)):
        existence[target[row]] += mass[row]
    best, factor = np.empty((targets, most), np.int64), np.empty(targets)
    for row in range(len(target)):
        one = target[row]
        if mass[row] < least_share * existence[one] or not mass[row] > 0.0:
            continue
        # Insertion in descending order of mass; of too many, the last one is dropped.
        place = size[one]
        while place > 0 and mass[best[one, place - 1]] < mass[row]:
            if place < most:
                best[one, place] = best[one, place - 1]
            place -= 1
        if place < most:
            best[one, place] = row
            size[one] = min(size[one] + 1, most)
    total = 0
    for one in range(targets):
        left = 0.0
        for place in range(size[one]):
            left += mass[best[one, place]]
        factor[one] = existence[one] / left if left > 0.0 else 1.0
        total += size[one]
    kept, by_row = np.empty(total, np.int64), np.empty(total)
    total = 0
    for one in range(targets):
        for place in range(size[one]):
            kept[total], by_row[total] = best[one, place], factor[one]
            total += 1
    return kept, by_row
