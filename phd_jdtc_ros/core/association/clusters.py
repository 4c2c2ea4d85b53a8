"""Clusters: the connected parts of the graph of targets and detections.

The nodes of the graph are the targets, 0 to T - 1, and after them the detections, T to T + M - 1. A
cluster is named by its first node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import IntArray
from ..compilation import Int1, compiled, inner


class Graph(NamedTuple):
    """C clusters of N nodes with E edges."""

    first: Int1  # The first node of each cluster, and N, (C + 1,)
    middle: Int1  # The first detection of each cluster, (C,); its targets are the nodes before
    target: Int1  # Node of each edge's target, (E,)
    detection: Int1  # Node of each edge's detection, (E,)
    start: Int1  # Where the edges of each node begin in `link`, and 2 E, (N + 1,)
    link: Int1  # The edges of each node, (2 E,)


@inner
def _root(cluster: IntArray, node: int) -> int:
    """Return the first node of a node's cluster; halve the way to it."""
    while cluster[node] != node:
        cluster[node] = cluster[cluster[node]]
        node = cluster[node]
    return node


@compiled
def clusters_of(targets: int, size: int, target: Int1, detection: Int1) -> IntArray:
    """Return the first node of each node's cluster, shape (T + M,).

    `targets` and `size` are T and M, and `target` and `detection`, (E,), the edges.
    """
    cluster = np.arange(targets + size)
    for edge in range(len(target)):
        root, other_root = _root(cluster, target[edge]), _root(cluster, targets + detection[edge])
        cluster[max(root, other_root)] = min(root, other_root)
    for node in range(targets + size):
        cluster[node] = _root(cluster, node)
    return cluster


@compiled
def graph_of(targets: int, size: int, target: Int1, detection: Int1) -> tuple[IntArray, Graph]:
    """Return the nodes that have edges, sorted by cluster, and the graph of their indices there.

    For the parameters see `clusters_of`.
    """
    edges, cluster = len(target), clusters_of(targets, size, target, detection)
    degree, members = np.zeros(targets + size, np.int64), np.zeros(targets + size, np.int64)
    for edge in range(edges):
        degree[target[edge]] += 1
        degree[targets + detection[edge]] += 1
    for node in range(targets + size):
        members[cluster[node]] += degree[node] > 0
    # A cluster is named by its first node, so that its place is known when that comes.
    clusters, nodes = 0, 0
    first, middle = np.zeros(targets + 1, np.int64), np.zeros(targets, np.int64)
    cluster_number, free = np.zeros(targets, np.int64), np.zeros(targets, np.int64)
    index_of = np.zeros(targets + size, np.int64)
    for node in range(targets + size):
        if degree[node] == 0:
            continue
        root = cluster[node]
        if root == node:
            first[clusters], cluster_number[node], free[clusters] = nodes, clusters, nodes
            clusters, nodes = clusters + 1, nodes + members[node]
        index_of[node] = free[cluster_number[root]]
        free[cluster_number[root]] += 1
        if node < targets:
            middle[cluster_number[root]] = free[cluster_number[root]]
    first[clusters] = nodes
    order, start = np.zeros(nodes, np.int64), np.zeros(nodes + 1, np.int64)
    for node in range(targets + size):
        if degree[node]:
            order[index_of[node]] = node
            start[index_of[node] + 1] = degree[node]
    start = np.cumsum(start)
    target_end, detection_end = index_of[target], index_of[targets + detection]
    link, room = np.empty(2 * edges, np.int64), start.copy()
    for edge in range(edges):
        for node in (target_end[edge], detection_end[edge]):
            link[room[node]] = edge
            room[node] += 1
    return order, Graph(
        first[: clusters + 1], middle[:clusters], target_end, detection_end, start, link
    )
