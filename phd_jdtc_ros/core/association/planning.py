"""The order in which the edges of clusters are processed, with few nodes open at a time.

A node is a target or a detection. Each step passes the node that opens the fewest others, with all
its remaining edges. A node is open from its first edge until it is passed or its last edge is
processed; a node that is passed at its first edge is never open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import IntArray
from ..compilation import Int1, Writeable, compiled, inner
from .clusters import Graph

# Largest number of entries of a cluster's tables after the edges of each step, 16 MiB in total; the
# tables before them are at most twice as large. A larger cluster is left out.
MOST_ENTRIES = 1 << 21
# A node's score has OPENS for each node that it would open, and APART if neither the node nor any
# of its neighbours is open.
OPENS, APART = 1 << 20, 1 << 42


class Plan(NamedTuple):
    """The steps of all clusters, one after the other."""

    # The first step of each cluster, and S, (C + 1,); clusters too expensive to plan have no steps.
    first: Int1
    # Size of the table before each step: 2 to the power of the number of open nodes, (S,).
    table_before: Int1
    # Size of the table after its edges, without the node that the step passes, (S,).
    table_size: Int1
    passed: Int1  # The node that each step passes, (S,)
    # Bit of this node in the table before the step; the table's size if it is not open, (S,).
    passed_bit: Int1
    # Where the edges of each step begin in `edge`, and the end of the last, (S + 1,).
    edge_start: Int1
    # Where the other nodes that each step closes begin in `node`, and their number, (S + 1,).
    node_start: Int1
    edge: Int1  # The edges in the order of the steps, (E,)
    edge_bit: Int1  # Bit of each edge's other node in the table after the step's edges, (E,)
    node: Int1  # The nodes that are not passed, in the order in which they are closed
    node_bit: Int1  # Bit of each of these nodes in the same table, ascending within a step


@inner
def _lower_score(node: int, score: IntArray, near: IntArray, found: int) -> int:
    """Lower the score of a node that is opened or passed, or of its neighbour.

    `near` lists the nodes that are no longer apart; return their number.
    """
    if score[node] >= APART:
        score[node] -= APART
        near[found] = node
        found += 1
    score[node] -= OPENS
    return found


@inner
def _lower_scores(graph: Graph, node: int, score: IntArray, near: IntArray, found: int) -> int:
    """Lower the scores of a node that is opened or passed, and of its neighbours."""
    found = _lower_score(node, score, near, found)
    for place in range(graph.start[node], graph.start[node + 1]):
        link = graph.link[place]
        neighbour = graph.target[link] + graph.detection[link] - node
        found = _lower_score(neighbour, score, near, found)
    return found


@inner
def _least_score(score: IntArray, low: int, high: int) -> int:
    """Return the first node of the least score among those from `low` to `high`."""
    node = low
    for candidate in range(low + 1, high):
        if score[candidate] < score[node]:
            node = candidate
    return node


@inner
def _next_node(
    edges_left: IntArray, score: IntArray, near: IntArray, found: int
) -> tuple[int, int]:
    """Return the first node of the least score among those in `near` that have edges left.

    It opens the fewest nodes, and among those nodes has the most edges left. Nodes without edges
    are removed from the list; return also how many remain.
    """
    best, count = near[0], 0
    for index in range(found):
        node = near[index]
        if edges_left[node]:
            near[count] = node
            count += 1
            is_first = node < best and score[node] == score[best]
            if not edges_left[best] or score[node] < score[best] or is_first:
                best = node
    return best, count


@inner
def _take_out(node: int, open_place: IntArray, members: IntArray, width: int) -> tuple[int, int]:
    """Take a node out of the open ones; return its bit, and their number.

    The bit of a node that is not open is the size of the table.
    """
    place = open_place[node]
    if place < 0:
        return 1 << width, width
    for index in range(place, width - 1):
        members[index] = members[index + 1]
        open_place[members[index]] = index
    return 1 << place, width - 1


@inner
def _close_nodes(
    edges_left: IntArray,
    open_place: IntArray,
    members: IntArray,
    width: int,
    node: IntArray,
    node_bit: IntArray,
    closed: int,
) -> tuple[int, int]:
    """Close the open nodes that have no edges left; the others move up in `members`.

    Return how many nodes are open, and how many nodes of all clusters have been closed.
    """
    still_open = 0
    for index in range(width):
        member = members[index]
        if edges_left[member]:
            members[still_open], open_place[member] = member, still_open
            still_open += 1
        else:
            node[closed], node_bit[closed] = member, 1 << index
            closed += 1
    return still_open, closed


@compiled
def plan(graph: Writeable[Graph], most_work: int) -> Plan:
    """Return the steps of clusters that are affordable.

    `most_work` limits the work for each target of a cluster, in edges times entries of a table.
    """
    edges_left = graph.start[1:] - graph.start[:-1]
    score, open_place = APART + edges_left * (OPENS - 1), np.full_like(edges_left, -1)
    # The open nodes by their places, and the nodes that are open or have an open neighbour.
    members, near = np.empty_like(edges_left), np.empty_like(edges_left)
    first, step = np.zeros_like(graph.first), 0
    table_before, table_size = np.empty_like(edges_left), np.empty_like(edges_left)
    passed, passed_bit = np.empty_like(edges_left), np.empty_like(edges_left)
    edge_start, node_start = np.zeros_like(graph.start), np.zeros_like(graph.start)
    edge, edge_bit = np.empty_like(graph.target), np.empty_like(graph.target)
    node, node_bit = np.empty_like(edges_left), np.empty_like(edges_left)
    for cluster in range(len(graph.middle)):
        low, high = graph.first[cluster], graph.first[cluster + 1]
        budget = most_work * (graph.middle[cluster] - low)
        width = entries = found = 0
        ordered, closed = edge_start[step], node_start[step]
        last = ordered + (graph.start[high] - graph.start[low]) // 2
        while ordered < last:
            table_before[step] = 1 << width
            if found:
                opener, found = _next_node(edges_left, score, near, found)
            else:
                opener = _least_score(score, low, high)
            if open_place[opener] < 0:
                found = _lower_scores(graph, opener, score, near, found)
            passed[step] = opener
            passed_bit[step], width = _take_out(opener, open_place, members, width)
            for place in range(graph.start[opener], graph.start[opener + 1]):
                link = graph.link[place]
                neighbour = graph.target[link] + graph.detection[link] - opener
                if edges_left[neighbour]:
                    if open_place[neighbour] < 0:
                        members[width], open_place[neighbour] = neighbour, width
                        found = _lower_scores(graph, neighbour, score, near, found)
                        width += 1
                    edge[ordered], edge_bit[ordered] = link, 1 << open_place[neighbour]
                    edges_left[neighbour] -= 1
                    score[neighbour] += 1
                    ordered += 1
            edges_left[opener] = 0
            table_size[step] = 1 << min(width, 40)  # Exceeds all limits
            entries += table_size[step]
            budget -= (ordered - edge_start[step]) * table_size[step]
            if budget < 0 or entries > MOST_ENTRIES:
                step = first[cluster]
                break
            width, closed = _close_nodes(
                edges_left, open_place, members, width, node, node_bit, closed
            )
            step += 1
            edge_start[step], node_start[step] = ordered, closed
        first[cluster + 1] = step
    return Plan(
        first,
        table_before[:step],
        table_size[:step],
        passed[:step],
        passed_bit[:step],
        edge_start[: step + 1],
        node_start[: step + 1],
        edge,
        edge_bit,
        node[: node_start[step]],
        node_bit[: node_start[step]],
    )
