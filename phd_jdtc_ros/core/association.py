# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Which target each detection comes from: marginal probabilities by belief propagation.

A target has one detection at the most and a detection one source at the most. The exact marginals
of that are exponential in the number of detections that are competed for. Loopy belief propagation
on the bipartite graph of targets and detections is linear in its edges, always converges, and is
exact wherever the graph is a tree. Where it has loops and neither clutter nor missed detections
leave it a way out, as with two loud targets and their two detections, it takes the likelier
matching for certain; so clusters with loops are solved exactly where they are small.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from .matching import matching_marginals
from .types import FloatArray, IntArray, sum_by

ITERATIONS = 200
TOLERANCE = 1e-6
# Sums without one term are formed by subtraction. Odds against clutter beyond this are as good as
# certain, and below it nothing is lost to rounding.
LEAST_CLUTTER = 1e-9
# Clusters with more detections are left to belief propagation.
EXACT_DETECTIONS = 7


def marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the marginal probabilities of single-source, single-detection associations.

    Exact but for clusters with loops and more than `EXACT_DETECTIONS` detections.

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges, none twice.
    odds : array of shape (E,)
        Of that detection against none, for the target alone: the mass that the edge explains over
        the probability that the target has no detection.
    targets : int
        T.
    clutter : array of shape (M,)
        What else may explain each detection, in the units of `odds`.

    Returns
    -------
    edge : array of shape (E,)
        Probability that the target is the detection's source.
    none : array of shape (T,)
        Probability that the target has no detection, be it missed or not there.

    References
    ----------
    Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
    propagation", IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014.
    """
    clutter = np.maximum(clutter, LEAST_CLUTTER)
    edge = np.empty(len(target))
    loops = _small_loops(target, detection, targets, len(clutter))
    alone = np.ones(len(target), dtype=bool)
    for edges in loops:
        alone[edges] = False
    rest = np.flatnonzero(alone)
    edge[rest], none = _propagated(target[rest], detection[rest], odds[rest], targets, clutter)
    for edges in loops:
        of, own = np.unique(target[edges], return_inverse=True)
        sought, column = np.unique(detection[edges], return_inverse=True)
        ratio = odds[edges] / clutter[detection[edges]]
        edge[edges], none[of] = matching_marginals(own, column, ratio, len(of), len(sought))
    return edge, none


def _propagated(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the marginals by belief propagation."""
    rival = clutter[detection]
    free = 1.0 / rival  # message to the target: how free the detection is
    for _ in range(ITERATIONS):
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
    of = cluster[target]
    found = [np.flatnonzero(of == c) for c in chosen]
    return [own[np.argsort(target[own], kind="stable")] for own in found]
