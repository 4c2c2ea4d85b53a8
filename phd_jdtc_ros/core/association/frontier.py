"""Exact association probabilities in clusters, by a frontier programme.

A step passes a node with all its remaining edges, of which a matching has at most one. A node is
open from its first edge until it is passed or its last edge is processed. A table has, for each
subset of the open nodes (the frontier), the summed weight of the matchings of the edges processed
so far that use exactly these nodes. The probability of an edge is a sum of products of a forward
and a backward table. The size of a table is two to the power of the number of open nodes, which are
few where targets compete with their neighbours only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..compilation import Float1, Writeable, compiled, in_place, inner
from .clusters import Graph
from .planning import Plan

# Largest excess of the prices in a cluster over the log weight of its best matching; see
# `node_prices`. exp underflows below about -700.
SLACK = 300.0
# Smallest increment of a bid, which bounds the number of bids in a large cluster. There the excess
# may be larger than SLACK, but it is distributed over the targets.
LEAST_RISE = 2.0


class _Tables(NamedTuple):
    """The probabilities of edges and of unmatched nodes, and working arrays for a cluster."""

    edge: Float1  # (E,)
    unmatched: Float1  # (N,)
    entries: Float1  # The forward tables
    buffer: Float1  # A forward or backward table between two steps
    earlier: Float1  # The separated backward table before the edges of a step


@inner
def _unmatched_states(states: int, bit: int) -> int:
    """Return how many of a table's states are without a node: all of them if it is not open."""
    assert bit > 0  # The compiler then knows that no index counts from the end.
    return min(max(states // 2, bit), states)


@inner
def _state(index: int, bit: int) -> int:
    """Return one of the states without a node, of which the index is the rank."""
    return index + (index & -bit)


@inner
def _separate(table: FloatArray, bit: int, separated: FloatArray) -> float:
    """Write the entries without a node, then those with it; return the largest one."""
    count, largest = _unmatched_states(len(table), bit), 0.0
    for index in range(count):
        separated[index] = table[_state(index, bit)]
    for index in range(len(table) - count):
        separated[count + index] = table[_state(index, bit) + bit]
    for state in range(len(table)):
        if table[state] > largest:
            largest = table[state]
    return largest


@inner
def _join(separated: FloatArray, bit: int, factor: float, table: FloatArray) -> None:
    """Write a factor times the entries in the order that `_separate` gives them."""
    count = _unmatched_states(len(table), bit)
    for index in range(count):
        table[_state(index, bit)] = factor * separated[index]
    for index in range(len(table) - count):
        table[_state(index, bit) + bit] = factor * separated[count + index]


@inner
def _add_edge(unmatched: FloatArray, bit: int, weight: float, table: FloatArray) -> None:
    """Add the matchings with an edge of the passed node to the table after the step's edges.

    `unmatched` are the entries before them without this node, and `bit` is that of the other one.
    """
    for index in range(_unmatched_states(len(unmatched), bit)):
        state = _state(index, bit)
        table[state + bit] += weight * unmatched[state]


@inner
def _add_edge_backward(
    unmatched: FloatArray, bit: int, weight: float, later: FloatArray, earlier: FloatArray
) -> float:
    """Add the matchings with an edge to the backward table before the edges; return their sum."""
    total = 0.0
    for index in range(_unmatched_states(len(unmatched), bit)):
        state = _state(index, bit)
        share = weight * later[state + bit]
        earlier[state] += share
        total += unmatched[state] * share
    return total


@inner
def _close_node(table: FloatArray, bit: int, free: float, buffer: FloatArray) -> FloatArray:
    """Return a table summed over a node, matched or not; `table` and `buffer` may share memory."""
    closed = buffer[: _unmatched_states(len(table), bit)]
    for index in range(len(closed)):
        state = _state(index, bit)
        closed[index] = free * table[state] + table[state + bit]
    return closed


@inner
def _reopen_node(later: FloatArray, bit: int, free: float, buffer: FloatArray) -> FloatArray:
    """Return the backward table before a node was closed; it may share memory with `buffer`."""
    reopened = buffer[: 2 * len(later)]
    for index in range(_unmatched_states(len(reopened), bit) - 1, -1, -1):
        state, entry = _state(index, bit), later[index]
        reopened[state + bit], reopened[state] = entry, free * entry
    return reopened


@inner
def _unmatched_share(table: FloatArray, later: FloatArray, bit: int) -> float:
    """Return the share of the matchings that leave a node unmatched."""
    total = 0.0
    for index in range(_unmatched_states(len(table), bit)):
        total += table[_state(index, bit)] * later[_state(index, bit)]
    return total


@inner
def _sum_forward(
    plan: Plan,
    step: int,
    weight: FloatArray,
    free: FloatArray,
    separated: FloatArray,
    largest: float,
    table: FloatArray,
) -> None:
    """Write the table after a step's edges, relative to the largest entry before them."""
    node = plan.passed[step]
    unmatched = separated[: _unmatched_states(len(separated), plan.passed_bit[step])]
    for state in range(len(table)):
        table[state] = 0.0
    for state in range(len(unmatched)):
        table[state] = free[node] / largest * unmatched[state]
    for state in range(len(separated) - len(unmatched)):
        table[state] += separated[len(unmatched) + state] / largest
    for index in range(plan.edge_start[step], plan.edge_start[step + 1]):
        edge_weight = weight[plan.edge[index]] / largest
        _add_edge(unmatched, plan.edge_bit[index], edge_weight, table)


@inner
def _sum_backward(
    plan: Plan,
    step: int,
    weight: FloatArray,
    free: FloatArray,
    separated: FloatArray,
    later: FloatArray,
    tables: _Tables,
) -> float:
    """Write the separated backward table before a step's edges, and the shares of its matchings.

    Return the sum of all matchings.
    """
    edge_share, unmatched_share, earlier = tables.edge, tables.unmatched, tables.earlier
    node = plan.passed[step]
    unmatched = separated[: _unmatched_states(len(separated), plan.passed_bit[step])]
    total = 0.0
    for state in range(len(unmatched)):
        earlier[state] = free[node] * later[state]
        total += unmatched[state] * earlier[state]
    unmatched_share[node] = total
    for state in range(len(separated) - len(unmatched)):
        earlier[len(unmatched) + state] = later[state]
        total += separated[len(unmatched) + state] * later[state]
    for index in range(plan.edge_start[step], plan.edge_start[step + 1]):
        edge = plan.edge[index]
        edge_share[edge] = _add_edge_backward(
            unmatched, plan.edge_bit[index], weight[edge], later, earlier
        )
        total += edge_share[edge]
    return total


@in_place
def _write_probabilities(
    plan: Writeable[Plan],
    begin: int,
    end: int,
    weight: Float1,
    free: Float1,
    tables: Writeable[_Tables],
) -> None:
    """Write the probabilities of a cluster with the steps from `begin` to `end`.

    They are products of its forward and backward tables.
    """
    edge_probability, unmatched, entries, buffer, earlier = tables
    buffer[0], table, filled = 1.0, buffer[:1], 0
    for step in range(begin, end):
        separated = entries[filled : filled + len(table)]
        largest = _separate(table, plan.passed_bit[step], separated)
        filled += len(table)
        table = entries[filled : filled + plan.table_size[step]]
        filled += len(table)
        _sum_forward(plan, step, weight, free, separated, largest, table)
        for index in range(plan.node_start[step + 1] - 1, plan.node_start[step] - 1, -1):
            table = _close_node(table, plan.node_bit[index], free[plan.node[index]], buffer)
    # Backward tables are such that their products with the forward tables sum to 1.
    buffer[0], later = 1.0 / table[0], buffer[:1]
    for step in range(end - 1, begin - 1, -1):
        table = entries[filled - plan.table_size[step] : filled]
        filled -= len(table)
        separated = entries[filled - plan.table_before[step] : filled]
        filled -= len(separated)
        for index in range(plan.node_start[step], plan.node_start[step + 1]):
            later = _reopen_node(later, plan.node_bit[index], free[plan.node[index]], buffer)
        total = _sum_backward(plan, step, weight, free, separated, later, tables)
        for index in range(plan.edge_start[step], plan.edge_start[step + 1]):
            edge_probability[plan.edge[index]] /= total
        unmatched[plan.passed[step]] /= total
        for index in range(plan.node_start[step], plan.node_start[step + 1]):
            unmatched[plan.node[index]] = _unmatched_share(table, later, plan.node_bit[index])
        later = buffer[: len(separated)]
        _join(earlier, plan.passed_bit[step], 1.0 / total, later)


@compiled
def matching_probabilities(
    plan: Writeable[Plan], weight: Float1, free: Float1
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities that edges are matched, (E,), and that nodes are unmatched, (N,).

    They are zero in clusters without steps. `weight`, (E,), and `free`, (N,), are the factors of a
    matching for each of its edges and for each unmatched node.
    """
    edge, unmatched, most, largest = np.zeros(len(weight)), np.zeros(len(free)), 0, 1
    for cluster in range(len(plan.first) - 1):
        entries = 0
        for step in range(plan.first[cluster], plan.first[cluster + 1]):
            entries += plan.table_before[step] + plan.table_size[step]
            largest = max(largest, plan.table_before[step], plan.table_size[step])
        most = max(most, entries)
    arrays = np.empty(most), np.empty(largest), np.empty(largest)
    for cluster in range(len(plan.first) - 1):
        begin, end = plan.first[cluster], plan.first[cluster + 1]
        if begin < end:
            _write_probabilities(plan, begin, end, weight, free, _Tables(edge, unmatched, *arrays))
    return edge, unmatched


@compiled
def node_prices(graph: Writeable[Graph], log_odds: Float1) -> FloatArray:
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
            for place in range(graph.start[bidder], graph.start[bidder + 1]):
                edge = graph.link[place]
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
