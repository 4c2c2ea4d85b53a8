"""Thinning of the backward kernel's rows to a systematic selection of their entries.

After a long interval nearly every particle of a set may descend from nearly every particle of the
previous one, and the number of pairs grows with the square of the particles. A row of more than
`MAX_PAIRS_PER_ROW` pairs is therefore reduced to the pairs that the teeth of a comb hit, in
proportion to kernel times weight. The memory is then linear in the number of particles.

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

from ...arrays import GOLDEN_RATIO, FloatArray, IntArray, run_starts
from ..resampling import comb

MAX_PAIRS_PER_ROW = 128
Triples = tuple[IntArray, IntArray, FloatArray]


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

    `row` has the later row of each pair, ascending and with all of its pairs, `column` the earlier
    row, `value` the kernel, and `weight` the weight of the earlier row. At most `MAX_PAIRS_PER_ROW`
    pairs per row are kept; each row keeps its sum of value times weight.
    """
    if not (row[MAX_PAIRS_PER_ROW:] == row[:-MAX_PAIRS_PER_ROW]).any():  # mostly no row is long
        return row, column, value
    first = run_starts(row)
    count = np.diff(np.append(first, len(row)))
    in_long_row = (count > MAX_PAIRS_PER_ROW).repeat(count)
    pair = np.flatnonzero(in_long_row)
    # The sort by column makes the selection independent of the order of the search.
    pair = pair[np.lexsort((column[pair], row[pair]))]
    long_row = row[first[count > MAX_PAIRS_PER_ROW]]
    group = np.arange(len(long_row)).repeat(count[count > MAX_PAIRS_PER_ROW])
    share = value[pair] * weight[pair]
    mu = np.bincount(group, share)
    # The combs of consecutive rows begin at different offsets, the same in every run.
    offset = np.asarray(long_row * GOLDEN_RATIO % 1.0)
    copies = comb(share, group, np.full(len(long_row), MAX_PAIRS_PER_ROW), offset)
    is_kept = np.logical_not(in_long_row)
    is_hit = copies > 0
    pair, group = pair[is_hit], group[is_hit]
    is_kept[pair] = True
    value = value.copy()
    value[pair] = copies[is_hit] * mu[group] / (MAX_PAIRS_PER_ROW * weight[pair])
    return row[is_kept], column[is_kept], value[is_kept]
