"""Marginal association probabilities of targets and detections.

A target has at most one detection, and a detection at most one source. The probabilities are exact
except in clusters in which very many targets compete for the same detections. Belief propagation
approximates these, and may be overconfident if the graph of targets and detections has loops.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import inner
from .belief_propagation import propagate, rounds
from .clusters import graph_of
from .frontier import matching_probabilities, node_prices
from .planning import plan

# Smallest clutter intensity, in the units of the odds. Larger odds are practically certain.
LEAST_CLUTTER = 1e-9
# Bound on the work for a cluster, per target, in entries of a table times edges, which take a
# nanosecond each. Twelve targets that compete for twelve detections are within it.
MOST_WORK = 1 << 16
# Largest log odds in belief propagation, which multiplies odds.
CERTAIN = 200.0


@inner
def _contested_probabilities(
    most_work: int,
    targets: int,
    size: int,
    target: IntArray,
    detection: IntArray,
    log_odds: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:
    """Return the probabilities of edges whose detections several targets want.

    `log_odds` are those of each edge against its target and its detection both being unmatched. See
    `edge_probabilities` for the result.
    """
    order, graph = graph_of(targets, size, target, detection)
    steps, price = plan(graph, most_work), node_prices(graph, log_odds)
    weight = np.empty(len(log_odds))
    for edge in range(len(weight)):
        edge_price = price[graph.target[edge]] + price[graph.detection[edge]]
        weight[edge] = math.exp(log_odds[edge] - edge_price)
    probability, unmatched = matching_probabilities(steps, weight, np.exp(-price))
    none, approximate = np.ones(targets), 0
    left_out = np.zeros(len(order), np.bool_)
    for cluster in range(len(graph.middle)):
        if steps.first[cluster] == steps.first[cluster + 1]:
            left_out[graph.first[cluster] : graph.first[cluster + 1]] = True
            approximate += 1
    left_out_edges = np.flatnonzero(left_out[graph.target])
    odds = np.exp(np.minimum(log_odds[left_out_edges], CERTAIN))
    edge_share, propagated = propagate(
        targets,
        size,
        target[left_out_edges],
        detection[left_out_edges],
        odds,
        rounds(len(left_out_edges)),
    )
    for index in range(len(left_out_edges)):
        probability[left_out_edges[index]] = edge_share[index]
    for node in range(len(order)):
        if order[node] < targets:
            none[order[node]] = propagated[order[node]] if left_out[node] else unmatched[node]
    return probability, none, approximate


# It is compiled as a part of its only caller: compiled on its own, it would be optimised twice.
@inner
def edge_probabilities(
    most_work: int,
    targets: int,
    target: IntArray,
    detection: IntArray,
    odds: FloatArray,
    clutter: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:
    """Return the marginal probabilities of single-source, single-detection associations.

    They are, for each edge, that the target is the detection's source, (E,), and for each target
    that it has no detection, because it was missed or does not exist, (T,). The number of clusters
    follows that were too large for exact sums: their probabilities come from belief propagation,
    and may be overconfident. `most_work` bounds the work for each target; see `MOST_WORK`.

    `target` and `detection`, (E,), are the edges, each once. `odds`, (E,), are those of the
    detection against none for this target alone: the mass of the edge, divided by the probability
    that the target has no detection. `clutter`, (M,), is the intensity of all other sources of each
    detection in the same units.
    """
    count, size, contested = len(odds), len(clutter), 0
    log_odds, share = np.empty(count), np.zeros(count)
    largest, claimants = np.zeros(targets), np.zeros(size, np.int64)
    for edge in range(count):
        if odds[edge] > 0.0:
            other = max(clutter[detection[edge]], LEAST_CLUTTER)
            log_odds[edge] = math.log(odds[edge]) - math.log(other)
            largest[target[edge]] = max(largest[target[edge]], log_odds[edge])
            claimants[detection[edge]] += 1
    # Alternatives of each target alone, divided by the largest: no detection, or one that no other
    # target wants.
    missed = np.exp(-largest)
    alternatives = missed.copy()
    for edge in range(count):
        if odds[edge] > 0.0:
            log_odds[edge] -= largest[target[edge]]
            share[edge] = math.exp(log_odds[edge])
            if claimants[detection[edge]] > 1:
                contested += 1
            else:
                alternatives[target[edge]] += share[edge]
    contested_edges, filled = np.empty(contested, np.int64), 0
    for edge in range(count):
        if odds[edge] > 0.0 and claimants[detection[edge]] > 1:
            log_odds[edge] -= math.log(alternatives[target[edge]])
            contested_edges[filled] = edge
            filled += 1
    contested_share, none, approximate = np.zeros(0), np.ones(targets), 0
    if contested:
        contested_share, none, approximate = _contested_probabilities(
            most_work,
            targets,
            size,
            target[contested_edges],
            detection[contested_edges],
            log_odds[contested_edges],
        )
    for edge in range(count):
        share[edge] *= none[target[edge]] / alternatives[target[edge]]
    for index in range(contested):
        share[contested_edges[index]] = contested_share[index]
    return share, missed * none / alternatives, approximate
