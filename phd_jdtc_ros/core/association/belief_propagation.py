"""Association probabilities by loopy belief propagation: linear in the edges of the graph.

It always converges. If the graph has loops and both clutter and missed detections are improbable,
as with two targets of high SNR and their two detections, it assigns almost all probability to the
more probable matching.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float1, Int1, compiled, inner

ITERATIONS = 200
# Bound on edges times iterations; it keeps a graph of millions of edges within seconds.
MOST_WORK = 1 << 25
TOLERANCE = 1e-6


@inner
def rounds(edges: int) -> int:
    """Return the largest number of iterations for a number of edges."""
    least_iterations = 10
    return min(ITERATIONS, max(MOST_WORK // max(edges, 1), least_iterations))


@compiled
def propagate(
    targets: int, size: int, target: Int1, detection: Int1, odds: Float1, iterations: int
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities of edges, (E,), and of targets without one, (T,).

    `targets` and `size` are T and M, `target` and `detection` the edges, and `odds` those of each
    edge against both its target and its detection having none.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    count = len(odds)
    # The message to the target is the availability of the detection.
    claim, available = np.empty(count), np.ones(count)
    for _ in range(iterations):
        share, claimed = np.zeros(targets), np.zeros(size)
        for edge in range(count):
            share[target[edge]] += odds[edge] * available[edge]
        for edge in range(count):
            others = max(share[target[edge]] - odds[edge] * available[edge], 0.0)
            claim[edge] = odds[edge] / (1.0 + others)
            claimed[detection[edge]] += claim[edge]
        is_changing = False
        for edge in range(count):
            availability = 1.0 / (1.0 + max(claimed[detection[edge]] - claim[edge], 0.0))
            is_changing = (
                is_changing or abs(availability - available[edge]) > TOLERANCE * available[edge]
            )
            available[edge] = availability
        if not is_changing:
            break
    total = np.ones(targets)
    for edge in range(count):
        total[target[edge]] += odds[edge] * available[edge]
    return odds * available / total[target], 1.0 / total
