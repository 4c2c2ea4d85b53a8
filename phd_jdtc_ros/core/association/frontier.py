"""Exact association probabilities in clusters, by a frontier programme.

The edges are processed in a fixed order, and a node is open from its first edge to its last. A
table has, for each subset of the open nodes (the frontier), the summed weight of the matchings of
the edges processed so far that use exactly these nodes. The probability of an edge is a sum of
products of a forward and a backward table. The size of a table is two to the power of the number of
open nodes, which are few where targets compete with their neighbours only.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float1, compiled, inner
from .clusters import Graph
from .planning import Plan

# Largest excess of the prices in a cluster over the log weight of its best matching; see
# `node_prices`. exp underflows below about -700.
SLACK = 300.0
# Smallest increment of a bid, which bounds the number of bids in a large cluster. There the excess
# may be larger than SLACK, but it is distributed over the targets.
LEAST_RISE = 2.0


@inner
def _add_edge(table: FloatArray, lower: int, upper: int, weight: float) -> None:
    """Add the matchings with an edge to a forward table."""
    for block in range(0, len(table), 2 * upper):
        for base in range(block, block + upper, 2 * lower):
            for state in range(base, base + lower):
                table[state + lower + upper] += weight * table[state]


@inner
def _add_edge_backward(
    table: FloatArray, later: FloatArray, lower: int, upper: int, weight: float
) -> float:
    """Add the matchings with an edge to a backward table; return the edge's probability."""
    total = 0.0
    for block in range(0, len(table), 2 * upper):
        for base in range(block, block + upper, 2 * lower):
            for state in range(base, base + lower):
                share = weight * later[state + lower + upper]
                later[state] += share
                total += table[state] * share
    return total


@inner
def _close_node(table: FloatArray, bit: int, free: float, buffer: FloatArray) -> FloatArray:
    """Return a table summed over a node, matched or not; `table` and `buffer` may share memory."""
    closed = buffer[: len(table) // 2]
    for base in range(0, len(closed), bit):
        for state in range(base, base + bit):
            closed[state] = free * table[base + state] + table[base + state + bit]
    return closed


@inner
def _reopen_node(later: FloatArray, bit: int, free: float, buffer: FloatArray) -> FloatArray:
    """Return the backward table before a node was closed; it may share memory with `buffer`."""
    reopened = buffer[: 2 * len(later)]
    for base in range(len(later) - bit, -1, -bit):
        for state in range(base + bit - 1, base - 1, -1):
            reopened[base + state + bit] = later[state]
            reopened[base + state] = free * later[state]
    return reopened


@inner
def _unmatched_probability(table: FloatArray, later: FloatArray, bit: int) -> float:
    """Return the probability that a node is unmatched."""
    total = 0.0
    for base in range(0, len(table), 2 * bit):
        for state in range(base, base + bit):
            total += table[state] * later[state]
    return total


@inner
def _product(table: FloatArray, later: FloatArray) -> float:
    """Return the scalar product; that of BLAS would wait for its threads on a busy machine."""
    total = 0.0
    for state in range(len(table)):
        total += table[state] * later[state]
    return total


@inner
def _largest_table(table_size: IntArray, steps: tuple[int, int]) -> int:
    """Return the size of the largest table of some steps."""
    largest = 0
    for step in range(*steps):
        largest = max(largest, table_size[step])
    return largest


@inner
def _scale(table: FloatArray) -> None:
    """Divide a table by its largest entry."""
    largest = 0.0
    for state in range(len(table)):
        largest = max(largest, table[state])
    for state in range(len(table)):
        table[state] /= largest


@inner
def _forward_tables(
    plan: Plan, steps: tuple[int, int], weight: FloatArray, free: FloatArray
) -> FloatArray:
    """Return the forward tables of a cluster, one after the other, each after a step's edges."""
    entries = 0
    for step in range(*steps):
        entries += plan.table_size[step]
    tables, buffer = np.zeros(entries), np.ones(_largest_table(plan.table_size, steps))
    table, end = buffer[:1], 0
    for step in range(*steps):
        begin, end = end, end + plan.table_size[step]
        initial = tables[begin : begin + len(table)]
        initial += table
        table = tables[begin:end]
        for index in range(plan.edge_start[step], plan.edge_start[step + 1]):
            _add_edge(table, plan.lower_bit[index], plan.upper_bit[index], weight[plan.edge[index]])
        for index in range(plan.node_start[step + 1] - 1, plan.node_start[step] - 1, -1):
            table = _close_node(table, plan.node_bit[index], free[plan.node[index]], buffer)
        _scale(table)
    return tables


@inner
def _write_probabilities(
    plan: Plan,
    steps: tuple[int, int],
    weight: FloatArray,
    free: FloatArray,
    tables: FloatArray,
    edge_probability: FloatArray,
    unmatched: FloatArray,
) -> None:
    """Write a cluster's probabilities: products of its forward and backward tables."""
    buffer, begin = np.ones(_largest_table(plan.table_size, steps)), len(tables)
    later = buffer[:1]
    for step in range(steps[1] - 1, steps[0] - 1, -1):
        begin, end = begin - plan.table_size[step], begin
        table = tables[begin:end]
        for index in range(plan.node_start[step], plan.node_start[step + 1]):
            later = _reopen_node(later, plan.node_bit[index], free[plan.node[index]], buffer)
        later /= _product(table, later)
        for index in range(plan.node_start[step], plan.node_start[step + 1]):
            unmatched[plan.node[index]] = _unmatched_probability(table, later, plan.node_bit[index])
        for index in range(plan.edge_start[step], plan.edge_start[step + 1]):
            edge_index = plan.edge[index]
            edge_probability[edge_index] = _add_edge_backward(
                table, later, plan.lower_bit[index], plan.upper_bit[index], weight[edge_index]
            )
        later = later[: plan.table_before[step]]


@compiled
def matching_probabilities(
    plan: Plan, weight: Float1, free: Float1
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities that edges are matched, (E,), and that nodes are unmatched, (N,).

    They are zero in clusters without steps. `weight`, (E,), and `free`, (N,), are the factors of a
    matching for each of its edges and for each unmatched node.
    """
    edge, unmatched = np.zeros(len(weight)), np.zeros(len(free))
    for cluster in range(len(plan.first) - 1):
        steps = plan.first[cluster], plan.first[cluster + 1]
        if steps[0] == steps[1]:
            continue
        _write_probabilities(
            plan, steps, weight, free, _forward_tables(plan, steps, weight, free), edge, unmatched
        )
    return edge, unmatched


@compiled
def node_prices(graph: Graph, log_odds: Float1) -> FloatArray:
    """Return the price (dual variable) of each node, (N,).

    The prices of an edge's two nodes sum to at least its log odds. Targets bid for detections as in
    an auction, so that the prices of a cluster exceed the log weight of its best matching by at
    most `SLACK`, or by `LEAST_RISE` for each target. The log odds, (E,), are those of each edge
    against leaving both its nodes unmatched.

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
            best_detection = -1
            for edge in graph.link[graph.start[bidder] : graph.start[bidder + 1]]:
                value = log_odds[edge] - price[graph.detection[edge]]
                if value > best:
                    best, second, best_detection = value, best, graph.detection[edge]
                elif value > second:
                    second = value
            if best_detection < 0:
                continue
            price[best_detection] += best - second + rise
            if owner[best_detection] >= 0:
                bidders[waiting] = owner[best_detection]
                waiting += 1
            owner[best_detection] = bidder
    for edge in range(len(log_odds)):
        value = log_odds[edge] - price[graph.detection[edge]]
        price[graph.target[edge]] = max(price[graph.target[edge]], value)
    return price
