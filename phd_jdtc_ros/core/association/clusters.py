"""Clusters: the connected parts of the graph of targets and detections.

The nodes of the graph are the targets, 0 to T - 1, and after them the detections, T to T + M - 1. A
cluster is named by its first node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import IntArray, run_starts
from ..compilation import Int1


class Graph(NamedTuple):
    """C clusters of N nodes with E edges.

    Parameters
    ----------
    first : int array of shape (C + 1,)
        The first node of each cluster, and N.
    middle : int array of shape (C,)
        The first detection of each cluster; its targets are the nodes before.
    target, detection : int arrays of shape (E,)
        The nodes of each edge.
    start : int array of shape (N + 1,)
        Where the edges of each node begin in `link`, and 2 E.
    link : int array of shape (2 E,)
        The edges of each node.
    """

    first: Int1
    middle: Int1
    target: Int1
    detection: Int1
    start: Int1
    link: Int1


def cluster_of_nodes(target: IntArray, detection: IntArray, targets: int, size: int) -> IntArray:
    """Return the first node of each node's cluster, shape (T + M,).

    Parameters
    ----------
    target, detection : int arrays of shape (E,)
        The edges.
    targets, size : int
        T and M.

    Notes
    -----
    In every round each cluster found so far joins a neighbour, so the rounds are at most as many as
    the logarithm of the nodes. For small graphs this takes a quarter of the time of
    `scipy.sparse.csgraph.connected_components`, and at most twice its time for large ones.
    """
    first = np.arange(targets + size)
    own, other = target, targets + detection
    while True:
        lower, upper = np.minimum(own, other), np.maximum(own, other)
        if (lower == upper).all():
            return first
        np.minimum.at(first, upper, lower)
        while True:
            before, first = first, first.take(first)
            if (first == before).all():
                break
        own, other = first.take(own), first.take(other)


def graph_of(
    target: IntArray, detection: IntArray, targets: int, size: int
) -> tuple[IntArray, Graph]:
    """Return the nodes that have edges, cluster by cluster, and the graph of their places there.

    The parameters are those of `cluster_of_nodes`.
    """
    cluster = cluster_of_nodes(target, detection, targets, size)
    ends = np.concatenate([target, targets + detection])
    degree = np.bincount(ends, minlength=targets + size)
    nodes = np.flatnonzero(degree)
    order = nodes.take(np.argsort(cluster.take(nodes), kind="stable"))
    place = np.empty(targets + size, dtype=np.int64)
    place[order] = np.arange(len(order))
    ends = place.take(ends)
    first = np.append(run_starts(cluster.take(order)), len(order))
    middle = first[:-1] + np.add.reduceat((order < targets).astype(np.int64), first[:-1])
    start = np.append(0, np.cumsum(degree.take(order)))
    link = np.argsort(ends, kind="stable") % len(target)
    ends, other = ends.reshape(2, -1)
    return order, Graph(first, middle, ends, other, start, link)
