# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How many partners a row of the backward kernel keeps.

After a long interval nearly every row of a cloud may have come from nearly every row of the one
before, and a kernel of all those pairs grows with the square of the particles. Rows with more than
`MOST` partners therefore keep a systematic draw of them, as many times each as the backward kernel
makes it likely: what is expected stays the same, and the memory is linear in the particles. Few
draws are enough: with two of each row the estimates' variance is already bounded over time (Olsson
and Westerborn, "Efficient particle-based online smoothing in general hidden Markov models: the
PaRIS algorithm", Bernoulli 23(3), 2017).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..arrays import FloatArray, IntArray, run_starts
from .resampling import comb

MOST = 128
# Multiples of the golden section are spread evenly, whatever their number: the combs of rows that
# follow each other do not begin at one place.
GOLDEN_SECTION = 0.5 * (5.0**0.5 - 1.0)
Triples = tuple[IntArray, IntArray, FloatArray]


def offsets(row: IntArray) -> FloatArray:
    """Return where the comb of each row begins, between 0 and 1."""
    return np.asarray(row * GOLDEN_SECTION % 1.0)


def whole_rows(pairs: Iterable[Triples]) -> Iterator[Triples]:
    """Yield (row, column, value) of ascending rows so that no row is parted by a chunk's end."""
    none = np.zeros(0, dtype=np.int64)
    row, column, value = none, none, np.zeros(0)
    for chunk in pairs:
        row, column = np.concatenate((row, chunk[0])), np.concatenate((column, chunk[1]))
        value = np.concatenate((value, chunk[2]))
        # What stands in the last row may go on in the next chunk.
        last = int(row.searchsorted(row[-1])) if len(row) else 0
        yield row[:last], column[:last], value[:last]
        row, column, value = row[last:], column[last:], value[last:]
    yield row, column, value


def drawn(
    row: IntArray, column: IntArray, value: FloatArray, weight: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs with those of crowded rows drawn.

    Parameters
    ----------
    row : int array of shape (pairs,)
        Ascending; all pairs of a row are there.
    column : int array of shape (pairs,)
        The earlier rows.
    value : array of shape (pairs,)
        The kernel.
    weight : array of shape (pairs,)
        Of the earlier rows.

    Returns
    -------
    row, column, value : arrays of shape (kept,)
        Of a crowded row at most `MOST` pairs; the sum of its values times weights is what it was.
    """
    if not (row[MOST:] == row[:-MOST]).any():  # nobody has more, as is usual
        return row, column, value
    first = run_starts(row)
    count = np.diff(np.append(first, len(row)))
    crowded = (count > MOST).repeat(count)
    many = np.flatnonzero(crowded)
    # By column, so that the draw does not depend on the order in which pairs were found.
    many = many[np.lexsort((column[many], row[many]))]
    rows = row[first[count > MOST]]
    group = np.arange(len(rows)).repeat(count[count > MOST])
    share = value[many] * weight[many]
    mu = np.bincount(group, share)
    copies = comb(share, group, np.full(len(rows), MOST), offsets(rows))
    kept = np.logical_not(crowded)
    hit = copies > 0
    many, group = many[hit], group[hit]
    kept[many] = True
    value = value.copy()
    value[many] = copies[hit] * mu[group] / (MOST * weight[many])
    return row[kept], column[kept], value[kept]
