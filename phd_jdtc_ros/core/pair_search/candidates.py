"""What a search leaves to be tested, and the test.

Searches look at two coordinates of the points; only the test looks at all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ..arrays import FloatArray, IntArray
from . import kernels
from .intervals import CHUNK_PAIRS, chunks

# In cells or strips: what rounding may do to a place. Candidates may be too many, never too few.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Candidates:
    """What a search leaves to be tested: intervals of the sorted points.

    Parameters
    ----------
    query, point : arrays of shape (K, Q) and (K, P)
        Coordinates by axis, each block's most selective ones first; points in sorted order.
    limit : array of shape (Q,)
        Square radius of each query.
    rank : int array of shape (P,)
        Which point stands at each place of the sorted order.
    owner : int array of shape (I,)
        The query of each interval, ascending.
    start, count : int arrays of shape (I,)
        Interval i holds the places ``start[i]`` to ``start[i] + count[i]``.
    """

    query: FloatArray
    point: FloatArray
    limit: FloatArray
    rank: IntArray
    owner: IntArray
    start: IntArray
    count: IntArray


class Pairs(NamedTuple):
    """Queries and points that are near each other.

    Parameters
    ----------
    query, point : int arrays of shape (pairs,)
        Queries ascend.
    square : array of shape (pairs,)
        Square distance.
    """

    query: IntArray
    point: IntArray
    square: FloatArray


def near_chunks(found: Candidates) -> Iterator[Pairs]:
    """Test candidates chunk by chunk; yield, in order, the pairs that are truly near."""
    for part in chunks(found.count, CHUNK_PAIRS):
        owner, start, count = found.owner[part], found.start[part], found.count[part]
        query, place, square = kernels.chosen().near_pairs(
            found.query, found.point, found.limit, owner, start, count
        )
        yield Pairs(query, found.rank.take(place), square)
