"""Thinning of the backward kernel's rows to a systematic selection of their entries.

After a long interval nearly every particle of a set may descend from nearly every particle of the
previous one, and the number of pairs grows with the square of the particles. A row of more than
`MOST` pairs is therefore reduced to the pairs that the teeth of a comb hit, in proportion to kernel
times weight. The memory is then linear in the number of particles.

The selection is deterministic: the offset of a row's comb follows from the row's number, and the
offsets of many rows are spread evenly over one tooth. The selection of a single row is not an
unbiased draw, but over many rows a pair is hit in proportion to its share. Every row keeps its sum
of kernel times weight.

Deviation from Sec. IV-C, Step 4, which sums all pairs. Few pairs suffice: the two random draws per
row of the reference already bound the variance of the estimates over time.

References
----------
Olsson and Westerborn, "Efficient particle-based online smoothing in general hidden Markov models:
the PaRIS algorithm", Bernoulli 23(3), 2017.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ...arrays import FloatArray, IntArray, run_starts
from ..resampling import comb

MOST = 128
# Multiples of this ratio modulo 1 are spread evenly, whatever their number, so that the combs of
# consecutive rows begin at different offsets.
GOLDEN_SECTION = 0.5 * (5.0**0.5 - 1.0)
Triples = tuple[IntArray, IntArray, FloatArray]


def offsets(row: IntArray) -> FloatArray:
    """Return the offset of each row's comb, at least 0 and below 1; the same in every run."""
    return np.asarray(row * GOLDEN_SECTION % 1.0)


def complete_rows(pairs: Iterable[Triples]) -> Iterator[Triples]:
    """Yield (row, column, value) of ascending rows in chunks that end between rows."""
    none = np.zeros(0, dtype=np.int64)
    row, column, value = none, none, np.zeros(0)
    for chunk in pairs:
        row, column = np.concatenate((row, chunk[0])), np.concatenate((column, chunk[1]))
        value = np.concatenate((value, chunk[2]))
        # The last row may continue in the next chunk.
        last = int(row.searchsorted(row[-1])) if len(row) else 0
        yield row[:last], column[:last], value[:last]
        row, column, value = row[last:], column[last:], value[last:]
    yield row, column, value


def thin(
    row: IntArray, column: IntArray, value: FloatArray, weight: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs, with long rows replaced by a systematic selection of their pairs.

    Parameters
    ----------
    row : int array of shape (pairs,)
        Later rows, ascending; each with all of its pairs.
    column : int array of shape (pairs,)
        Earlier rows.
    value : array of shape (pairs,)
        The kernel.
    weight : array of shape (pairs,)
        Weight of each earlier row.

    Returns
    -------
    row, column, value : arrays of shape (kept,)
        At most `MOST` pairs per row. The sum of value times weight of each row is unchanged.
    """
    if not (row[MOST:] == row[:-MOST]).any():  # the usual case: no row is long
        return row, column, value
    first = run_starts(row)
    count = np.diff(np.append(first, len(row)))
    in_long_row = (count > MOST).repeat(count)
    pair = np.flatnonzero(in_long_row)
    # The sort by column makes the selection independent of the order of the search.
    pair = pair[np.lexsort((column[pair], row[pair]))]
    long_row = row[first[count > MOST]]
    group = np.arange(len(long_row)).repeat(count[count > MOST])
    share = value[pair] * weight[pair]
    mu = np.bincount(group, share)
    copies = comb(share, group, np.full(len(long_row), MOST), offsets(long_row))
    kept = np.logical_not(in_long_row)
    hit = copies > 0
    pair, group = pair[hit], group[hit]
    kept[pair] = True
    value = value.copy()
    value[pair] = copies[hit] * mu[group] / (MOST * weight[pair])
    return row[kept], column[kept], value[kept]
