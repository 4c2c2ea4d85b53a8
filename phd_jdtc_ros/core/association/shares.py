"""Factors from prior to posterior weights of Bernoulli targets.

A target consists of weighted rows, such as Gaussians, whose weights sum to its existence
probability. Only the target index of each row matters here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import IntArray
from ..compilation import Float1, Int1, Writeable, compiled, inner
from .claims import LEAST_MISSED, Claims
from .marginals import edge_probabilities


class Shares(NamedTuple):
    """The factors from prior to posterior weights.

    The posterior weight of a row of target g is ``prior * (1 - p_D) * missed[g]`` for a missed
    detection, and ``mass * pair`` for each of its pairs.
    """

    # Prior weights of the rows, (N,); targets with a mass above one are scaled to one.
    prior: Float1
    missed: Float1  # Factor of each target on its rows' weights for a missed detection, (T,)
    pair: Float1  # Factor of each pair, (P,)
    claimed: Float1  # Probability that a target is the source of each detection, (M,)
    # Number of clusters too large for exact probabilities; see `marginals`.
    approximate: int


@inner
def _join_pairs(
    targets: int, size: int, target_of: IntArray, row: IntArray, column: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the edge of each pair, and the target and the detection of each edge.

    Pairs of the same target and detection share an edge; edges are sorted by target.
    """
    start = np.zeros(targets + 1, np.int64)
    for pair in range(len(row)):
        start[target_of[row[pair]] + 1] += 1
    start = np.cumsum(start)
    order, free = np.empty(len(row), np.int64), start.copy()
    for pair in range(len(row)):
        target = target_of[row[pair]]
        order[free[target]] = pair
        free[target] += 1
    edge_of_pair, edge_of_column = np.empty(len(row), np.int64), np.full(size, -1)
    edge_target, edge_column = np.empty(len(row), np.int64), np.empty(len(row), np.int64)
    edges = 0
    for target in range(targets):
        first = edges
        for pair in order[start[target] : start[target + 1]]:
            z = column[pair]
            if edge_of_column[z] < first:
                edge_of_column[z] = edges
                edge_target[edges], edge_column[edges] = target, z
                edges += 1
            edge_of_pair[pair] = edge_of_column[z]
    return edge_of_pair, edge_target[:edges], edge_column[:edges]


@compiled
def posterior_shares(
    most_work: int,
    targets: int,
    target_of: Int1,
    weight: Float1,
    claims: Writeable[Claims],
) -> Shares:
    """Return the factors by which detections change the weights of Bernoulli targets.

    `target_of`, (N,), is the target of each row, below `targets`, T, and `weight` its prior weight;
    for `most_work` see `marginals.edge_probabilities`.

    Let r be the existence probability of the target, r p_D the probability that it is detected, and
    p_z and p_0 the marginal probabilities of its association with detection z and with none. Then
    w <- w [p_0 (1 - p_D) / (1 - r p_D) + sum_z p_z p_D L_z / sum_s p_D L_z w].

    References
    ----------
    Meyer et al., "Message passing algorithms for scalable multitarget tracking", Proceedings of
    the IEEE 106(2), 2018, for the same marginals in a particle filter of Bernoulli targets.
    """
    row, column, mass, other, detection_probability = claims
    # Rounding in the reduction of a set may leave a mass slightly above one.
    excess, detected = np.zeros(targets), np.zeros(targets)
    for row_index in range(len(target_of)):
        excess[target_of[row_index]] += weight[row_index]
    excess = np.maximum(excess, 1.0)
    prior = weight / excess[target_of]
    for row_index in range(len(target_of)):
        detected[target_of[row_index]] += prior[row_index] * detection_probability[row_index]
    missed = np.maximum(1.0 - detected, LEAST_MISSED)

    edge_of_pair, edge_target, edge_column = _join_pairs(
        targets, len(other), target_of, row, column
    )
    explained = np.zeros(len(edge_target))
    for pair in range(len(row)):
        explained[edge_of_pair[pair]] += mass[pair] / excess[target_of[row[pair]]]
    odds = explained / missed[edge_target]
    probability, none, approximate = edge_probabilities(
        most_work, targets, edge_target, edge_column, odds, other
    )
    claimed, share = np.zeros(len(other)), np.empty(len(row))
    for edge in range(len(edge_target)):
        claimed[edge_column[edge]] += probability[edge]
    for pair in range(len(row)):
        edge = edge_of_pair[pair]
        edge_mass = explained[edge] if explained[edge] > 0.0 else 1.0
        share[pair] = probability[edge] / edge_mass / excess[target_of[row[pair]]]
    return Shares(prior, none / missed, share, np.minimum(claimed, 1.0), approximate)
