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
# Clusters are tested for convergence after the iterations `FIRST_TESTS`, and later after every
# `TEST_EVERY`. Converged ones are removed if this leaves less than `WORTH_DROPPING` of the edges.
# Single edges converge at once, stars after two iterations.
FIRST_TESTS = (1, 2, 4, 8)
TEST_EVERY = 16
WORTH_DROPPING = 0.75


def propagate(
    target: IntArray,
    detection: IntArray,
    odds: FloatArray,
    targets: int,
    clutter: FloatArray,
    cluster: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the marginals by loopy belief propagation; exact where the graph is a tree.

    Parameters and returns are those of `marginals.marginals`; `clutter` is positive. `cluster`, of
    shape (E,) and below T, is the same for all edges of a cluster.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    if not len(odds):
        return odds.copy(), np.ones(targets)
    taken = odds * _availability(target, detection, odds, targets, clutter, cluster)
    total = 1.0 + sum_by(target, taken, targets)
    return taken / total.take(target), 1.0 / total


def _availability(
    target: IntArray,
    detection: IntArray,
    odds: FloatArray,
    targets: int,
    clutter: FloatArray,
    cluster: IntArray,
) -> FloatArray:
    """Return the messages to the targets: the availability of each detection, (E,)."""
    rival = clutter.take(detection)
    free = 1.0 / rival
    found, place = free, np.arange(len(odds))
    watched = 0  # until this edge has converged, the others need no test
    for iteration in range(min(ITERATIONS, max(MOST_WORK // len(odds), LEAST_ITERATIONS))):
        wanted = odds / (1.0 + _others(target, odds * free, targets))  # message to the detection
        before, free = free, 1.0 / (rival + _others(detection, wanted, len(clutter)))
        due = iteration in FIRST_TESTS or iteration % TEST_EVERY == 0
        if not due and abs(free[watched] - before[watched]) > TOLERANCE * before[watched]:
            continue
        change = np.abs(free - before)
        if (change <= TOLERANCE * before).all():
            break
        watched = int(np.argmax(change / before))
        if not due:
            continue
        # Messages of a cluster that did not change at all, as in a tree, never change again.
        moving = np.zeros(targets, dtype=bool)
        moving[cluster[change > 0.0]] = True
        kept = np.flatnonzero(moving.take(cluster))
        if len(kept) < WORTH_DROPPING * len(free):
            found[place], watched = free, 0
            target, detection, cluster = target.take(kept), detection.take(kept), cluster.take(kept)
            odds, rival, free = odds.take(kept), rival.take(kept), free.take(kept)
            place = place.take(kept)
    found[place] = free
    return found


def _others(index: IntArray, value: FloatArray, size: int) -> FloatArray:
    """Return, for each edge, the sum of `value` over the other edges of its node."""
    others = np.bincount(index, value, size).take(index) - value
    return np.maximum(others, 0.0, out=others)
