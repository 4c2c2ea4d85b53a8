"""Association probabilities by loopy belief propagation: linear in the edges of the graph.

It always converges. If the graph has loops and both clutter and missed detections are improbable,
as with two targets of high SNR and their two detections, it assigns almost all probability to the
more probable matching.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by

ITERATIONS = 200
# Bound on edges times iterations; it keeps a graph of millions of edges within seconds.
MOST_WORK = 1 << 25
LEAST_ITERATIONS = 10
TOLERANCE = 1e-6


def propagate(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, size: int
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities of edges, (E,), and of targets to have none, (T,).

    `odds`, (E,), are those of each edge against both its target and its detection having none; T is
    `targets`, and `size` is the number of detections.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    free = np.ones(len(odds))  # message to the target: how available the detection is
    for _ in range(min(ITERATIONS, max(MOST_WORK // max(len(odds), 1), LEAST_ITERATIONS))):
        wanted = odds / (1.0 + _others(target, odds * free, targets))  # message to the detection
        before, free = free, 1.0 / (1.0 + _others(detection, wanted, size))
        if (np.abs(free - before) <= TOLERANCE * before).all():
            break
    taken = odds * free
    total = 1.0 + sum_by(target, taken, targets)
    return taken / total.take(target), 1.0 / total


def _others(index: IntArray, value: FloatArray, size: int) -> FloatArray:
    """Return, for each edge, the sum of `value` over the other edges of its node."""
    others = np.bincount(index, value, size).take(index) - value
    return np.maximum(others, 0.0, out=others)
