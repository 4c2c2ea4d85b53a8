"""Exact association probabilities in clusters, by a frontier programme.

A table has the weight of all matchings of the edges passed so far, by the set of open nodes that
are taken: the frontier is all that they have in common with the edges to come. With tables of both
directions every probability is a sum. Their size is two to the power of the open nodes, which are
few where targets compete with their neighbours only, however many targets there are.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float1, compiled, inner
from .clusters import Graph
from .planning import Plan

# By how much a cluster may be worth more than its heaviest matching; doubles go down to exp(-700).
SLACK = 300.0
# A bid is higher by this at least, so that no cluster takes many: more slack, but not in one place.
LEAST_RISE = 2.0


@inner
def _take(table: FloatArray, lower: int, upper: int, weight: float) -> None:
    """Add the matchings with an edge to a table."""
    for block in range(0, len(table), 2 * upper):
        for base in range(block, block + upper, 2 * lower):
            for state in range(base, base + lower):
                table[state + lower + upper] += weight * table[state]


@inner
def _give(table: FloatArray, later: FloatArray, lower: int, upper: int, weight: float) -> float:
    """Add the matchings with an edge to the later ones; return the share of all that they have."""
    total = 0.0
    for block in range(0, len(table), 2 * upper):
        for base in range(block, block + upper, 2 * lower):
            for state in range(base, base + lower):
                share = weight * later[state + lower + upper]
                later[state] += share
                total += table[state] * share
    return total


@inner
def _closed(table: FloatArray, bit: int, free: float, room: FloatArray) -> FloatArray:
    """Return a table without one of its nodes, taken or free; both may begin the same array."""
    rest = room[: len(table) // 2]
    for base in range(0, len(rest), bit):
        for state in range(base, base + bit):
            rest[state] = free * table[base + state] + table[base + state + bit]
    return rest


@inner
def _reopened(later: FloatArray, bit: int, free: float, room: FloatArray) -> FloatArray:
    """Return what may come from before a node was closed; both may begin the same array."""
    whole = room[: 2 * len(later)]
    for base in range(len(later) - bit, -1, -bit):
        for state in range(base + bit - 1, base - 1, -1):
            whole[base + state + bit] = later[state]
            whole[base + state] = free * later[state]
    return whole


@inner
def _untaken(table: FloatArray, later: FloatArray, bit: int) -> float:
    """Return the share of the matchings that leave a node free."""
    total = 0.0
    for base in range(0, len(table), 2 * bit):
        for state in range(base, base + bit):
            total += table[state] * later[state]
    return total


@inner
def _before(plan: Plan, steps: tuple[int, int], weight: FloatArray, free: FloatArray) -> FloatArray:
    """Return the tables of a cluster's steps, one after the other, each after its edges."""
    sizes = plan.size[steps[0] : steps[1]]
    tables, room = np.zeros(sizes.sum()), np.ones(np.max(sizes))
    table, end = room[:1], 0
    for step in range(*steps):
        begin, end = end, end + plan.size[step]
        known = tables[begin : begin + len(table)]
        known += table
        table = tables[begin:end]
        for at in range(plan.passed[step], plan.passed[step + 1]):
            _take(table, plan.lower[at], plan.upper[at], weight[plan.edge[at]])
        for at in range(plan.closed[step + 1] - 1, plan.closed[step] - 1, -1):
            table = _closed(table, plan.bit[at], free[plan.node[at]], room)
        table /= np.max(table)
    return tables


@inner
def _after(
    plan: Plan,
    steps: tuple[int, int],
    weight: FloatArray,
    free: FloatArray,
    tables: FloatArray,
    edge: FloatArray,
    none: FloatArray,
) -> None:
    """Write the probabilities of a cluster: what was before each step times what may come after."""
    room, begin = np.ones(np.max(plan.size[steps[0] : steps[1]])), len(tables)
    later = room[:1]
    for step in range(steps[1] - 1, steps[0] - 1, -1):
        begin, end = begin - plan.size[step], begin
        table = tables[begin:end]
        for at in range(plan.closed[step], plan.closed[step + 1]):
            later = _reopened(later, plan.bit[at], free[plan.node[at]], room)
        later /= np.dot(table, later)
        for at in range(plan.closed[step], plan.closed[step + 1]):
            none[plan.node[at]] = _untaken(table, later, plan.bit[at])
        for at in range(plan.passed[step], plan.passed[step + 1]):
            one = plan.edge[at]
            edge[one] = _give(table, later, plan.lower[at], plan.upper[at], weight[one])
        later = later[: plan.before[step]]


@compiled
def sums(plan: Plan, weight: Float1, free: Float1) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities of edges, (E,), and of nodes to have none, (N,).

    Those of clusters without steps are zero.

    Parameters
    ----------
    plan : Plan
    weight, free : arrays of shape (E,) and (N,)
        Factors of a matching: for each of its edges, and for each node without one.
    """
    edge, none = np.zeros(len(weight)), np.zeros(len(free))
    for cluster in range(len(plan.first) - 1):
        steps = plan.first[cluster], plan.first[cluster + 1]
        if steps[0] == steps[1]:
            continue
        _after(plan, steps, weight, free, _before(plan, steps, weight, free), edge, none)
    return edge, none


@compiled
def prices(graph: Graph, log_odds: Float1) -> FloatArray:
    """Return the logarithms of what nodes are worth, (N,): two together at least as their edge.

    Targets bid for detections as in an auction, so that the nodes of a cluster together are worth
    little more than its heaviest matching: at most `SLACK`, or `LEAST_RISE` for each target.

    `log_odds`, (E,), are of each edge against both its nodes having none.

    References
    ----------
    Bertsekas, "The auction algorithm for assignment and other network flow problems: a tutorial",
    Interfaces 20(4), 1990.
    """
    price, owner = np.zeros(len(graph.start) - 1), np.full(len(graph.start) - 1, -1)
    for cluster in range(len(graph.middle)):
        low, middle = graph.first[cluster], graph.middle[cluster]
        bidders, waiting = np.arange(low, middle), middle - low
        rise = max(SLACK / waiting, LEAST_RISE)
        while waiting:
            waiting -= 1
            bidder = bidders[waiting]
            best = second = 0.0
            wanted = -1
            for edge in graph.link[graph.start[bidder] : graph.start[bidder + 1]]:
                value = log_odds[edge] - price[graph.detection[edge]]
                if value > best:
                    best, second, wanted = value, best, graph.detection[edge]
                elif value > second:
                    second = value
            if wanted < 0:
                continue
            price[wanted] += best - second + rise
            if owner[wanted] >= 0:
                bidders[waiting] = owner[wanted]
                waiting += 1
            owner[wanted] = bidder
    for edge in range(len(log_odds)):
        value = log_odds[edge] - price[graph.detection[edge]]
        price[graph.target[edge]] = max(price[graph.target[edge]], value)
    return price
