"""The order in which the edges of clusters are processed, with few nodes open at a time.

A node is a target or a detection, and is open from its first edge to its last one. Each step
processes all remaining edges of the node that opens the fewest others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import IntArray
from ..compilation import Int1, compiled, inner
from .clusters import Graph

# Largest number of entries of a cluster's tables, 32 MiB in total; a larger cluster is left out.
MOST_ENTRIES = 1 << 22
# A node's score has OPENS for each node that its step would open, and APART if neither the node nor
# any of its neighbours is open. The score of a closed node is CLOSED.
OPENS, APART, CLOSED = 1 << 20, 1 << 42, 1 << 60


class Plan(NamedTuple):
    """The steps of all clusters, one after the other."""

    # The first step of each cluster, and S, (C + 1,); clusters too expensive to plan have no steps.
    first: Int1
    # Size of the table before each step: 2 to the power of the number of open nodes, (S,).
    table_before: Int1
    table_size: Int1  # Size of the table with the nodes that the step opens, (S,)
    # Where the edges of each step begin in `edge`, and the end of the last, (S + 1,).
    edge_start: Int1
    # Where the nodes that each step closes begin in `node`, and the end of the last, (S + 1,).
    node_start: Int1
    edge: Int1  # The edges in the order of the steps, (E,)
    lower_bit: Int1  # Lower one of the two bits that each edge's nodes have in the table, (E,)
    upper_bit: Int1  # Higher one of these bits, (E,)
    node: Int1  # The nodes in the order in which they are closed, (N,)
    node_bit: Int1  # Bit in the table of each of these nodes, ascending within a step, (N,)


@inner
def _open_node(
    graph: Graph, node: int, score: IntArray, open_place: IntArray, members: IntArray, width: int
) -> int:
    """Open a node that is not open yet; return how many nodes are open.

    The node with the least score is next: the one that opens the fewest nodes, and among those the
    one with the most edges left.
    """
    if open_place[node] >= 0:
        return width
    members[width], open_place[node] = node, width
    score[node] -= OPENS + (APART if score[node] >= APART else 0)
    for link in graph.link[graph.start[node] : graph.start[node + 1]]:
        neighbour = graph.target[link] + graph.detection[link] - node
        score[neighbour] -= OPENS + (APART if score[neighbour] >= APART else 0)
    return width + 1


@inner
def _least_score(score: IntArray, low: int, high: int) -> int:
    """Return the first node of the least score among those from `low` to `high`."""
    node = low
    for candidate in range(low + 1, high):
        if score[candidate] < score[node]:
            node = candidate
    return node


@inner
def _close_nodes(
    edges_left: IntArray,
    score: IntArray,
    open_place: IntArray,
    members: IntArray,
    node: IntArray,
    node_bit: IntArray,
    closed: int,
) -> tuple[int, int]:
    """Close the open nodes, `members`, that have no edges left; the others move up.

    Return how many nodes are open, and how many nodes of all clusters have been closed.
    """
    width = 0
    for index in range(len(members)):
        member = members[index]
        if edges_left[member]:
            members[width], open_place[member] = member, width
            width += 1
        else:
            score[member] = CLOSED
            node[closed], node_bit[closed] = member, 1 << index
            closed += 1
    return width, closed


@compiled
def plan(graph: Graph, most_work: int) -> Plan:
    """Return the steps of clusters that are affordable.

    `most_work` limits the work for each target of a cluster, in edges times entries of a table.
    """
    edges_left = graph.start[1:] - graph.start[:-1]
    score, open_place = APART + edges_left * (OPENS - 1), np.full_like(edges_left, -1)
    members = np.empty_like(edges_left)  # the open nodes, by their places
    first, step = np.zeros_like(graph.first), 0
    table_before, table_size = np.empty_like(edges_left), np.empty_like(edges_left)
    edge_start, node_start = np.zeros_like(graph.start), np.zeros_like(graph.start)
    edge = np.empty_like(graph.target)
    node = np.empty_like(edges_left)
    node_bit = np.empty_like(edges_left)
    lower_bit, upper_bit = np.empty_like(edge), np.empty_like(edge)
    for cluster in range(len(graph.middle)):
        low, high = graph.first[cluster], graph.first[cluster + 1]
        budget = most_work * (graph.middle[cluster] - low)
        width = entries = 0
        ordered, closed = edge_start[step], node_start[step]
        last = ordered + (graph.start[high] - graph.start[low]) // 2
        while ordered < last:
            table_before[step] = 1 << width
            opener = _least_score(score, low, high)
            width = _open_node(graph, opener, score, open_place, members, width)
            for link in graph.link[graph.start[opener] : graph.start[opener + 1]]:
                neighbour = graph.target[link] + graph.detection[link] - opener
                if edges_left[neighbour]:
                    width = _open_node(graph, neighbour, score, open_place, members, width)
                    bits = 1 << open_place[opener], 1 << open_place[neighbour]
                    edge[ordered] = link
                    lower_bit[ordered], upper_bit[ordered] = min(bits), max(bits)
                    edges_left[neighbour] -= 1
                    score[neighbour] += 1
                    ordered += 1
            edges_left[opener] = 0
            table_size[step] = 1 << min(width, 40)  # exceeds all limits
            entries += table_size[step]
            budget -= (ordered - edge_start[step]) * table_size[step]
            if budget < 0 or entries > MOST_ENTRIES:
                step = first[cluster]
                break
            width, closed = _close_nodes(
                edges_left, score, open_place, members[:width], node, node_bit, closed
            )
            step += 1
            edge_start[step], node_start[step] = ordered, closed
        first[cluster + 1] = step
    return Plan(
        first,
        table_before[:step],
        table_size[:step],
        edge_start[: step + 1],
        node_start[: step + 1],
        edge,
        lower_bit,
        upper_bit,
        node,
        node_bit,
    )
