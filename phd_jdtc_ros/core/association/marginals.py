# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Marginal association probabilities of targets and detections.

A target has at most one detection, and a detection at most one source. The cost of exact marginals
is exponential in the number of contested detections. Belief propagation has linear cost and is
exact if the graph of targets and detections is a tree. Small clusters with loops are summed
exactly, because belief propagation may be overconfident there.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..arrays import FloatArray, IntArray
from .belief_propagation import propagate
from .exact_marginals import exact_marginals

# Sums without one term are formed by subtraction, which loses digits if odds against clutter are
# huge. With this bound they stay accurate, and larger odds are practically certain anyway.
LEAST_CLUTTER = 1e-9
# For clusters with more detections belief propagation is used.
EXACT_DETECTIONS = 7
# Each takes a millisecond; there are some hundreds where hundreds of targets are in clutter.
MOST_EXACT = 1000


def marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the marginal probabilities of single-source, single-detection associations.

    Exact except for clusters with loops and more than `EXACT_DETECTIONS` detections.

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges, each once.
    odds : array of shape (E,)
        Odds of that detection against none, for the target alone: the mass that the edge explains,
        divided by the probability that the target has no detection.
    targets : int
        T.
    clutter : array of shape (M,)
        Intensity of the other sources of each detection, in the units of `odds`.

    Returns
    -------
    edge : array of shape (E,)
        Probability that the target is the detection's source.
    none : array of shape (T,)
        Probability that the target has no detection, because it was missed or does not exist.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    clutter = np.maximum(clutter, LEAST_CLUTTER)
    edge = np.empty(len(target))
    loops = _small_loops(target, detection, targets, len(clutter))
    propagated = np.ones(len(target), dtype=bool)
    for edges in loops:
        propagated[edges] = False
    rest = np.flatnonzero(propagated)
    edge[rest], none = propagate(target[rest], detection[rest], odds[rest], targets, clutter)
    for edges in loops:
        members, row = np.unique(target[edges], return_inverse=True)
        detections, column = np.unique(detection[edges], return_inverse=True)
        ratio = odds[edges] / clutter[detection[edges]]
        edge[edges], none[members] = exact_marginals(
            row, column, ratio, len(members), len(detections)
        )
    return edge, none


def _small_loops(target: IntArray, detection: IntArray, targets: int, size: int) -> list[IntArray]:
    """Return the edges, by ascending target, of each small cluster that has loops."""
    nodes = targets + size
    graph = sparse.coo_array(
        (np.ones(len(target), dtype=np.int8), (target, targets + detection)), shape=(nodes, nodes)
    )
    count, cluster = connected_components(graph, directed=False)
    edges = np.bincount(cluster[target], minlength=count)
    members = np.bincount(cluster, minlength=count)
    detections = np.bincount(cluster[targets:], minlength=count)
    chosen = np.flatnonzero((edges >= members) & (detections <= EXACT_DETECTIONS))
    if len(chosen) > MOST_EXACT:
        largest = np.argsort(-edges[chosen], kind="stable")[:MOST_EXACT]
        chosen = np.sort(chosen[largest])
    # By cluster, and within it by target.
    cluster_of_edge = cluster[target]
    order = np.lexsort((target, cluster_of_edge))
    first = np.searchsorted(cluster_of_edge[order], chosen)
    return [order[f : f + n] for f, n in zip(first, edges[chosen], strict=True)]
