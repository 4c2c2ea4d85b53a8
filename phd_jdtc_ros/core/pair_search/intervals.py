"""Intervals of candidates, expanded in chunks.

A search gives every query intervals of a sorted list. Expanding all of them at once would need
temporary arrays of many megabytes, which do not fit the cache and cause page faults.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from ..arrays import IntArray

# Number of candidates per chunk: temporary arrays of 256 kB fit the second-level cache.
CHUNK_PAIRS = 1 << 15


def chunks(count: IntArray, most: int) -> Iterator[slice]:
    """Yield slices of the intervals, with about `most` candidates each, given their lengths."""
    running = np.cumsum(count)
    total = int(running[-1]) if len(running) else 0
    bounds = np.searchsorted(running, np.arange(0, total, most), side="right")
    for first, last in itertools.pairwise(np.append(np.unique(bounds), len(count))):
        yield slice(first, last)


def expand(owner: IntArray, start: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Return the owner and the index of every candidate.

    Interval i of query ``owner[i]`` has the indices from ``start[i]`` to ``start[i] + count[i]``,
    the last excluded.
    """
    place = np.arange(count.sum())
    place += (start - np.cumsum(count) + count).repeat(count)
    return owner.repeat(count), place
