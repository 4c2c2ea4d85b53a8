"""Marginal association probabilities of targets and detections.

A target has at most one detection, and a detection at most one source. The cost of exact marginals
is exponential in the number of contested detections. Belief propagation has linear cost and is
exact if the graph of targets and detections is a tree. Small clusters with loops are summed
exactly, because belief propagation may be overconfident there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from .batches import affordable_loops, sum_exactly
from .belief_propagation import propagate
from .clusters import cluster_of_nodes

# Smallest clutter intensity, in the units of the odds. A sum without one term is formed by
# subtraction, which would lose digits at larger odds; these are practically certain anyway.
LEAST_CLUTTER = 1e-9


class Marginals(NamedTuple):
    """Marginal probabilities of single-source, single-detection associations.

    Parameters
    ----------
    edge : array of shape (E,)
        Probability that the target is the detection's source.
    none : array of shape (T,)
        Probability that the target has no detection, because it was missed or does not exist.
    approximate : int
        Number of clusters with loops that were too large for exact sums. Their probabilities come
        from belief propagation and may be overconfident.
    """

    edge: FloatArray
    none: FloatArray
    approximate: int


def marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> Marginals:
    """Return the marginal probabilities of associations.

    They are exact except in clusters with loops that are too large for exact sums (`batches`).

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges, each once.
    odds : array of shape (E,)
        Odds of the detection against none for this target alone: the mass of the edge, divided by
        the probability that the target has no detection.
    targets : int
        T.
    clutter : array of shape (M,)
        Intensity of all other sources of each detection, in the units of `odds`.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    clutter = np.maximum(clutter, LEAST_CLUTTER)
    cluster = cluster_of_nodes(target, detection, targets, len(clutter))
    cluster_of_edge = cluster.take(target)
    loops, approximate = affordable_loops(cluster, cluster_of_edge, targets)
    if not len(loops.cluster):
        edge, none = propagate(target, detection, odds, targets, clutter, cluster_of_edge)
        return Marginals(edge, none, approximate)

    ratio = odds / clutter.take(detection)
    sums = sum_exactly(loops, cluster, target, detection, ratio, targets)
    propagated = np.ones(len(target), dtype=bool)
    propagated[sums.edge] = False
    rest = np.flatnonzero(propagated)
    edge = np.empty(len(target))
    target, detection, odds = target.take(rest), detection.take(rest), odds.take(rest)
    edge[rest], none = propagate(
        target, detection, odds, targets, clutter, cluster_of_edge.take(rest)
    )
    edge[sums.edge], none[sums.target] = sums.probability, sums.none
    return Marginals(edge, none, approximate)
