# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Intervals of candidates, expanded a few at a time.

Searches leave for every query an interval of a sorted list. Expanding all of them at once would
make temporaries of many megabytes, which leave the cache and keep paying for page faults.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from ..arrays import IntArray

# Candidates expanded at a time: temporaries of 256 kB stay inside the second-level cache.
CHUNK_PAIRS = 1 << 15


def chunks(count: IntArray, most: int) -> Iterator[slice]:
    """Cut intervals of these lengths into runs that hold about `most` candidates."""
    running = np.cumsum(count)
    total = int(running[-1]) if len(running) else 0
    bounds = np.searchsorted(running, np.arange(0, total, most), side="right")
    for first, last in itertools.pairwise(np.append(np.unique(bounds), len(count))):
        yield slice(first, last)


def expand(owner: IntArray, start: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Return for every candidate its owner and its place.

    Parameters
    ----------
    owner, start, count : int arrays of shape (I,)
        Interval i holds the places ``start[i]`` to ``start[i] + count[i]`` for ``owner[i]``.
    """
    place = np.arange(count.sum())
    place += (start - np.cumsum(count) + count).repeat(count)
    return owner.repeat(count), place
