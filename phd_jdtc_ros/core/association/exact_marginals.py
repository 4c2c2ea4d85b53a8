"""Exact association probabilities in many small clusters at once.

All matchings of a cluster's rows with its columns are summed by dynamic programming over the rows.
The state is a set of columns, so M columns have 2^M states. Rows are targets and columns are
detections, or the other way round: the rules are symmetric.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import backend
from ..arrays import FloatArray, IntArray

# Logarithm to base 2 of the largest weight of a matching. It keeps the sum over fewer than 2^100
# matchings finite; larger odds are practically certain.
LARGEST_WEIGHT = 840


class Batch(NamedTuple):
    """Clusters with the same number of columns.

    Parameters
    ----------
    row, column, cluster : int arrays of shape (E,)
        The edges, each once, in ascending order of their columns. Rows and columns are numbered
        within their cluster.
    odds : array of shape (E,)
        Odds of the association against both its row and its column being unassociated.
    rows : int array of shape (C,)
        The number of rows of each cluster, in descending order.
    size : int
        M, the number of columns of each cluster.
    """

    row: IntArray
    column: IntArray
    cluster: IntArray
    odds: FloatArray
    rows: IntArray
    size: int


class ExactMarginals:
    """The exact marginals of a batch; the cost grows with the edges of the clusters times 2^M."""

    def __init__(self, batch: Batch) -> None:
        odds = np.minimum(batch.odds, 2.0 ** (LARGEST_WEIGHT / batch.size))
        self._batch = batch._replace(odds=odds)
        self._weight = _weights(self._batch)
        self._clusters = np.arange(len(batch.rows))
        self._total = self._weight[batch.rows, 1, self._clusters, -1]

    def edges(self) -> FloatArray:
        """Return the probability of each edge, shape (E,)."""
        row, column, cluster, odds, rows, size = self._batch
        if loops := backend.compiled("association"):
            around = loops.around_edges(self._weight, row, column, cluster, rows)
            together: FloatArray = (around[0][:, None] @ around[1][..., None])[:, 0, 0]
            probability: FloatArray = odds * together / self._total.take(cluster)
            return probability
        from_last = rows.take(cluster) - 1 - row
        found = np.empty(len(row))
        end = np.searchsorted(column, np.arange(size), side="right").tolist()
        for z, some in enumerate(map(slice, [0, *end], end)):
            without = _halves(self._weight, z)[..., 0, :]
            earlier = without[row[some], 0, cluster[some]].reshape(-1, 1, 1 << (size - 1))
            # The later rows take columns in the complements of the states of the earlier rows.
            later = np.ascontiguousarray(without[from_last[some], 1, cluster[some]][:, ::-1, ::-1])
            found[some] = (earlier @ later.reshape(-1, 1 << (size - 1), 1))[:, 0, 0]
        edge: FloatArray = odds * found / self._total.take(cluster)
        return edge

    def unassociated_rows(self) -> FloatArray:
        """Return the probability that each row is unassociated, concatenated over clusters."""
        rows = self._batch.rows
        cluster = self._clusters.repeat(rows)
        row = np.arange(len(cluster)) - (np.cumsum(rows) - rows).take(cluster)
        earlier = self._weight[row, 0, cluster]
        later = self._weight[rows.take(cluster) - 1 - row, 1, cluster][:, ::-1]
        earlier *= later
        none: FloatArray = earlier.sum(axis=1) / self._total.take(cluster)
        return none

    def unassociated_columns(self) -> FloatArray:
        """Return the probability that each column is unassociated, shape (C, M)."""
        complete = self._weight[self._batch.rows, 0, self._clusters]
        without = [
            _halves(complete, z)[..., 0, :].sum(axis=(1, 2)) for z in range(self._batch.size)
        ]
        none: FloatArray = np.stack(without, axis=1) / self._total[:, None]
        return none


def _halves(states: FloatArray, column: int) -> FloatArray:
    """Reshape an axis of 2^M sets to (:, 2, :), where the axis of 2 is membership of the column."""
    return states.reshape(*states.shape[:-1], -1, 2, 1 << column)


def _weights(batch: Batch) -> FloatArray:
    """Return the total weights of matchings, (rows + 1, 2, C, 2^M).

    [t, 0, c, s] is the weight of the matchings of cluster c's first t rows with exactly the columns
    in the set s. [t, 1, c, s] is the weight of the matchings of its last t rows with any columns in
    s. Both have the same recursion, the second in reverse order of the rows. Entries beyond a
    cluster's own rows are undefined.
    """
    if loops := backend.compiled("association"):
        table: FloatArray = loops.weights(*batch)
        return table
    row, column, cluster, value, rows, size = batch
    most, count = int(rows[0]), len(rows)
    from_last = rows.take(cluster) - 1 - row
    odds = np.zeros((most, size, 2, 1, 1, count))
    odds[row, column, 0, 0, 0, cluster], odds[from_last, column, 1, 0, 0, cluster] = value, value
    occurs = np.zeros((most, size), dtype=bool)
    occurs[row, column], occurs[from_last, column] = True, True
    active = np.searchsorted(-rows, -np.arange(most)).tolist()  # clusters with more than t rows

    # Clusters are the last axis, so that inner loops run over all clusters and not over the short
    # runs of states with and without a column.
    weight = np.empty((most + 1, 2, 1 << size, count))
    weight[0, 0], weight[0, 1] = 0.0, 1.0
    weight[0, 0, 0] = 1.0
    halves = [weight.reshape(most + 1, 2, -1, 2, 1 << z, count) for z in range(size)]
    without = [half[:, :, :, 0] for half in halves]
    taken = [half[:, :, :, 1] for half in halves]
    for t in range(most):
        some = slice(active[t])
        weight[t + 1, ..., some] = weight[t, ..., some]
        for z in np.flatnonzero(occurs[t]).tolist():
            into = taken[z][t + 1, ..., some]
            into += odds[t, z, ..., some] * without[z][t, ..., some]
    return np.ascontiguousarray(weight.transpose(0, 1, 3, 2))
