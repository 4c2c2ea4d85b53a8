# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exact association probabilities of a few targets that compete for a few detections.

All matchings of targets with detections are summed by dynamic programming over the targets. The
state is the set of detections already taken, so M detections have 2^M states.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..arrays import FloatArray, IntArray


def exact_marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, size: int
) -> tuple[FloatArray, FloatArray]:
    """Return the exact marginals of a cluster.

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges, each once; targets in ascending order.
    odds : array of shape (E,)
        Odds of the association against both its target and its detection being unassociated.
    targets, size : int
        T and M; the cost grows with E 2^M.

    Returns
    -------
    edge : array of shape (E,)
    none : array of shape (T,)
        Probability that the target has no detection.
    """
    without, taken = _states(size)
    first = np.searchsorted(target, np.arange(targets + 1))
    # Row t, by set of taken detections: `before` is the total weight of the matchings of the
    # targets before t that take this set; `after` is that of the targets from t on, given it.
    before = np.zeros((targets + 1, 1 << size))
    after = np.ones((targets + 1, 1 << size))
    before[0, 0] = 1.0
    for t in range(targets):
        before[t + 1] = before[t]
        for e in range(first[t], first[t + 1]):
            z = detection[e]
            before[t + 1, taken[z]] += odds[e] * before[t, without[z]]
    for t in reversed(range(targets)):
        after[t] = after[t + 1]
        for e in range(first[t], first[t + 1]):
            z = detection[e]
            after[t, without[z]] += odds[e] * after[t + 1, taken[z]]
    total = after[0, 0]
    none = (before[:-1] * after[1:]).sum(axis=1) / total
    edge = np.array(
        [
            odds[e] * (before[t, without[z]] @ after[t + 1, taken[z]])
            for e, (t, z) in enumerate(zip(target.tolist(), detection.tolist(), strict=True))
        ]
    )
    return edge / total, none


@lru_cache
def _states(size: int) -> tuple[tuple[IntArray, ...], tuple[IntArray, ...]]:
    """Return for each detection the states without it, and the same states with it."""
    state = np.arange(1 << size)
    without = tuple(state[state & (1 << z) == 0] for z in range(size))
    return without, tuple(states | (1 << z) for z, states in enumerate(without))
