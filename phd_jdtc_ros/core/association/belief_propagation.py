# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Association probabilities by loopy belief propagation: linear in the edges of the graph.

It always converges. If the graph has loops and both clutter and missed detections are improbable,
as with two targets of high SNR and their two detections, it assigns almost all probability to the
more probable matching.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by

ITERATIONS = 200
# Edges times iterations, so that a graph of millions of edges takes no minutes.
MOST_WORK = 1 << 25
LEAST_ITERATIONS = 10
TOLERANCE = 1e-6


def propagate(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the marginals by loopy belief propagation; exact where the graph is a tree.

    Parameters and returns are those of `marginals.marginals`; `clutter` is positive.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    rival = clutter[detection]
    free = 1.0 / rival  # message to the target: how available the detection is
    affordable = max(MOST_WORK // max(len(odds), 1), LEAST_ITERATIONS)
    for _ in range(min(ITERATIONS, affordable)):
        taken = odds * free
        others = np.bincount(target, taken, targets).take(target) - taken
        wanted = odds / (1.0 + np.maximum(others, 0.0))  # message to the detection
        others = np.bincount(detection, wanted, len(clutter)).take(detection) - wanted
        before, free = free, 1.0 / (rival + np.maximum(others, 0.0))
        if (np.abs(free - before) <= TOLERANCE * before).all():
            break
    taken = odds * free
    total = 1.0 + sum_by(target, taken, targets)
    return taken / total[target], 1.0 / total
