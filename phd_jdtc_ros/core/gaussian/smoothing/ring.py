"""Tables in which the rows of a new scan replace those of the oldest one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

# Room of a ring, as a multiple of the rows that it is made for, beside the largest scan's, which
# may not fit before the end; and the least room, of which a few targets take little.
ROOM, LEAST_ROOM = 1.2, 1024


class Ring:
    """Columns of equal length in which the rows of a scan are adjacent, and replace the oldest."""

    def __init__(self, room: int, columns: Sequence[Any]) -> None:
        self.columns = [np.empty((room, *column.shape[1:]), column.dtype) for column in columns]
        self._room = room
        # First row and end of each scan, oldest first.
        self._scans: deque[tuple[int, int]] = deque()

    def append(self, *columns: Any) -> int:
        """Append the rows of a scan; return the first one, or -1 if there is no room."""
        oldest, begin = (self._scans[0][0], self._scans[-1][1]) if self._scans else (0, 0)
        size, room = len(columns[0]), self._room
        if begin < oldest:
            room = oldest - 1  # a ring that is full would seem empty
        elif begin + size > room:
            begin, room = 0, oldest - 1
        if begin + size > room:
            return -1
        self._scans.append((begin, begin + size))
        for column, values in zip(self.columns, columns, strict=True):
            column[begin : begin + size] = values
        return begin

    def drop(self) -> None:
        """Drop the rows of the oldest scan."""
        self._scans.popleft()


def ring_for(parts: Sequence[Sequence[Any]]) -> Ring:
    """Return a ring with room for parts that have these columns."""
    sizes = [len(columns[0]) for columns in parts]
    return Ring(max(round(ROOM * sum(sizes)) + max(sizes), LEAST_ROOM), parts[0])
