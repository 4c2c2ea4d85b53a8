"""Selection of the clusters for exact sums, and their grouping into batches.

The smaller side of a cluster, targets or detections, is in general the columns of the dynamic
programme in `exact_marginals`, and the other side the rows. The cost is exponential in the columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from .exact_marginals import Batch, ExactMarginals

# Up to this number, the detections are the columns even if there are fewer targets. This costs
# little, and clusters with the same number of columns are summed together.
FEW_DETECTIONS = 7
# Largest table, in entries, of a batch of several clusters. It fits the processor's cache; with
# 2^17 entries the sums take twice as long.
LARGEST_BATCH = 1 << 15
# Overhead of one step of the dynamic programme, in units of one state of one edge.
STEP = 1000
# Bounds on the work for one cluster and for all clusters, in states of an edge, which take a few
# nanoseconds each. Twelve targets that compete for twelve detections are within `LARGEST_CLUSTER`;
# its table has 16 MiB.
LARGEST_CLUSTER = 1 << 20
MOST_WORK = 1 << 22


class Loops(NamedTuple):
    """Clusters with loops, in the order of their batches.

    Parameters
    ----------
    cluster : int array of shape (C,)
        First node of each cluster.
    rows, columns : int arrays of shape (C,)
    swapped : bool array of shape (C,)
        Whether the detections are the rows and the targets the columns.
    """

    cluster: IntArray
    rows: IntArray
    columns: IntArray
    swapped: npt.NDArray[np.bool_]


class Sums(NamedTuple):
    """Exact marginals of some edges and targets.

    Parameters
    ----------
    edge, probability : arrays of shape (E,)
        Indices of edges, and their probabilities.
    target, none : arrays of shape (T,)
        Targets, and their probabilities of no detection.
    """

    edge: IntArray
    probability: FloatArray
    target: IntArray
    none: FloatArray


def affordable_loops(
    cluster: IntArray, cluster_of_edge: IntArray, targets: int
) -> tuple[Loops, int]:
    """Return the clusters with loops that are summed exactly, and the number of other ones.

    Parameters
    ----------
    cluster : int array of shape (T + M,)
        That of `clusters.cluster_of_nodes`.
    cluster_of_edge : int array of shape (E,)
        The same for the edges.
    targets : int
        T.
    """
    nodes = len(cluster)
    edges = np.bincount(cluster_of_edge, minlength=nodes)
    members = np.bincount(cluster, minlength=nodes)
    # A tree has one edge fewer than nodes. Only first nodes have members.
    found = np.flatnonzero(edges >= np.maximum(members, 1))
    own = np.bincount(cluster[:targets], minlength=nodes).take(found)
    detections = members.take(found) - own
    swapped = (detections > FEW_DETECTIONS) & (own < detections)
    rows, columns = np.where(swapped, (detections, own), (own, detections))

    states = np.ldexp(1.0, np.minimum(columns, 64))
    # The clusters of a batch share the overhead of a step.
    share = np.minimum(2.0 * (rows + 1) * states / LARGEST_BATCH, 1.0)
    work = edges.take(found) * (states + STEP * share)
    cheapest = np.argsort(work, kind="stable")
    cost = work.take(cheapest)
    chosen = cheapest[(cost <= LARGEST_CLUSTER) & (np.cumsum(cost) <= MOST_WORK)]
    order = np.lexsort((-rows.take(chosen), columns.take(chosen), swapped.take(chosen)))
    chosen = chosen.take(order)
    loops = Loops(*(part.take(chosen) for part in (found, rows, columns, swapped)))
    return loops, len(found) - len(chosen)


def sum_exactly(
    loops: Loops,
    cluster: IntArray,
    target: IntArray,
    detection: IntArray,
    odds: FloatArray,
    targets: int,
) -> Sums:
    """Return the exact marginals in clusters with loops.

    Parameters
    ----------
    cluster : int array of shape (T + M,)
        That of `clusters.cluster_of_nodes`.
    target, detection : int arrays of shape (E,)
        The edges of all clusters.
    odds : array of shape (E,)
        Odds of the association against both its target and its detection being unassociated.
    targets : int
        T.
    """
    number = np.full(len(cluster), -1)
    number[loops.cluster] = np.arange(len(loops.cluster))
    number = number.take(cluster)
    members, place_of_target = _places(number[:targets])
    _, place_of_detection = _places(number[targets:])

    edge = np.flatnonzero(number.take(target) >= 0)
    target, detection, odds = target.take(edge), detection.take(edge), odds.take(edge)
    number = number.take(target)
    row, column = place_of_target.take(target), place_of_detection.take(detection)
    row, column = np.where(loops.swapped.take(number), (column, row), (row, column))
    order, probability, none = [], [], []
    for edges, batch, swapped in _batches(loops, number, row, column, odds):
        found = ExactMarginals(batch)
        order.append(edges)
        probability.append(found.edges())
        none.append(found.unassociated_columns().ravel() if swapped else found.unassociated_rows())
    edge = edge.take(np.concatenate(order))
    return Sums(edge, np.concatenate(probability), members, np.concatenate(none))


def _batches(
    loops: Loops, number: IntArray, row: IntArray, column: IntArray, odds: FloatArray
) -> Iterator[tuple[IntArray, Batch, bool]]:
    """Yield the edges of each batch, the batch, and whether its rows are detections.

    `number` is the number of each edge's cluster; `row` and `column` are indices within it.
    """
    first = _firsts(loops)
    index = np.searchsorted(first, number, side="right") - 1
    order = np.lexsort((column, index))
    end = np.searchsorted(index.take(order), np.arange(len(first) - 1), side="right")
    last = [*first[1:], len(loops.cluster)]
    for own, start, stop in zip(np.split(order, end), first, last, strict=True):
        batch = Batch(
            row.take(own),
            column.take(own),
            number.take(own) - start,
            odds.take(own),
            loops.rows[start:stop],
            int(loops.columns[start]),
        )
        yield own, batch, bool(loops.swapped[start])


def _firsts(loops: Loops) -> list[int]:
    """Return the index of each batch's first cluster."""
    same = (loops.columns[1:] == loops.columns[:-1]) & (loops.swapped[1:] == loops.swapped[:-1])
    first: list[int] = []
    start = 0
    for end in [*(np.flatnonzero(~same) + 1).tolist(), len(loops.cluster)]:
        while start < end:
            first.append(start)
            entries = (int(loops.rows[start]) + 1) << (int(loops.columns[start]) + 1)
            start = min(start + max(LARGEST_BATCH // entries, 1), end)
    return first


def _places(number: IntArray) -> tuple[IntArray, IntArray]:
    """Return the nodes sorted by the number of their cluster, and each node's index within it.

    `number` is -1 for nodes of other clusters, whose indices are undefined.
    """
    order = np.argsort(number, kind="stable")
    ordered = number.take(order)
    place = np.empty(len(number), dtype=np.int64)
    place[order] = np.arange(len(number)) - np.searchsorted(ordered, ordered)
    return order[np.searchsorted(ordered, 0) :], place
