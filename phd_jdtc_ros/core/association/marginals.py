"""Marginal association probabilities of targets and detections.

A target has at most one detection, and a detection at most one source. The probabilities are exact,
but for clusters in which very many compete for the same detections: these are left to belief
propagation, which may be overconfident where the graph of targets and detections has loops.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from . import frontier, planning
from .belief_propagation import propagate
from .clusters import graph_of

# Smallest clutter intensity, in the units of the odds. Larger odds are practically certain.
LEAST_CLUTTER = 1e-9
# Work on a cluster for each of its targets, in entries of a table times edges: a nanosecond each.
# Twelve targets that compete for twelve detections are within it.
MOST_WORK = 1 << 17
# Of odds, as a logarithm, so that belief propagation may multiply them.
CERTAIN = 200.0


class Marginals(NamedTuple):
    """Marginal probabilities of single-source, single-detection associations.

    Parameters
    ----------
    edge : array of shape (E,)
        Probability that the target is the detection's source.
    none : array of shape (T,)
        Probability that the target has no detection, because it was missed or does not exist.
    approximate : int
        Number of clusters that were too large for exact sums. Their probabilities come from belief
        propagation and may be overconfident.
    """

    edge: FloatArray
    none: FloatArray
    approximate: int


def marginals(
    target: IntArray, detection: IntArray, odds: FloatArray, targets: int, clutter: FloatArray
) -> Marginals:
    """Return the marginal probabilities of associations.

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
    """
    possible = np.flatnonzero(odds)
    target, detection = target.take(possible), detection.take(possible)
    log_odds = np.log(odds.take(possible))
    log_odds -= np.log(np.maximum(clutter, LEAST_CLUTTER)).take(detection)
    # What a target has of its own, no detection or one that no other target wants, by its largest.
    largest = np.zeros(targets)
    np.maximum.at(largest, target, log_odds)
    log_odds -= largest.take(target)
    contested = np.bincount(detection, minlength=len(clutter)).take(detection) > 1
    some, alone = np.flatnonzero(contested), np.flatnonzero(~contested)
    missed, share = np.exp(-largest), np.exp(log_odds)
    own = missed + sum_by(target.take(alone), share.take(alone), targets)
    log_odds -= np.log(own).take(target)

    contest = _contest(
        target.take(some), detection.take(some), log_odds.take(some), targets, len(clutter)
    )
    rest = contest.none / own
    share *= rest.take(target)
    share[some] = contest.edge
    edge = np.zeros(len(odds))
    edge[possible] = share
    return Marginals(edge, missed * rest, contest.approximate)


def _contest(
    target: IntArray, detection: IntArray, log_odds: FloatArray, targets: int, size: int
) -> Marginals:
    """Return the marginals of edges; `log_odds` are against both nodes having none of them."""
    none = np.ones(targets)
    if not len(target):
        return Marginals(log_odds, none, 0)
    order, graph = graph_of(target, detection, targets, size)
    plan = planning.plan(graph, MOST_WORK)
    price = frontier.prices(graph, log_odds)
    weight = np.exp(log_odds - price.take(graph.target) - price.take(graph.detection))
    edge, untaken = frontier.sums(plan, weight, np.exp(-price))
    own = order < targets
    none[order[own]] = untaken[own]
    beyond = np.flatnonzero(plan.first[1:] == plan.first[:-1])
    if len(beyond):
        cluster = np.searchsorted(graph.first, np.arange(len(order)), side="right") - 1
        left_out = np.isin(cluster, beyond)
        edges, nodes = np.flatnonzero(left_out.take(graph.target)), order[left_out & own]
        odds = np.exp(np.minimum(log_odds.take(edges), CERTAIN))
        edge[edges], propagated = propagate(
            target.take(edges), detection.take(edges), odds, targets, size
        )
        none[nodes] = propagated[nodes]
    return Marginals(edge, none, len(beyond))
