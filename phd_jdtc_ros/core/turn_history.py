# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latest reports of a turning radar, so that one that comes late is cut in its place.

What a report covers follows from those before it. With a late report the later ones are cut again,
and become what they would have been.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from operator import attrgetter
from typing import NamedTuple

from .scans import Rejection
from .turns import Piece, State, Turns
from .types import Detections


class _Record(NamedTuple):
    """A report, what was known before it, and its parts."""

    stamp_ns: int
    detections: Detections
    sector: int | None
    before: State
    pieces: tuple[Piece, ...]


class Recut(NamedTuple):
    """What a late report changes.

    Parameters
    ----------
    stamps_ns : tuple of int
        Of the parts of later reports as they were cut first.
    pieces : tuple of (stamp in nanoseconds, Detections)
        The parts of the late report and of all later ones, by ascending stamp.
    """

    stamps_ns: tuple[int, ...]
    pieces: tuple[Piece, ...]


class TurnHistory:
    """Cuts the reports of one radar, and can do so again with a late one; see `Turns.split`."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._records: list[_Record] = []

    def split(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Piece] | Rejection:
        """Return the parts of a report that is not late."""
        before, late = self._turns.state, self._turns.behind(stamp_ns)
        if self._records and stamp_ns < self._records[-1].stamp_ns and not late:
            self.clear()  # of another run
        pieces = self._turns.split(stamp_ns, detections, sector)
        if not isinstance(pieces, Rejection) and not late:
            self._records.append(_Record(stamp_ns, detections, sector, before, tuple(pieces)))
        return pieces

    def later(self, stamp_ns: int) -> int:
        """Return the number of reports after a stamp."""
        return len(self._records) - self._place(stamp_ns)

    def reported(self, stamp_ns: int) -> bool:
        """Return whether a report with this stamp has come."""
        place = self._place(stamp_ns)
        return place > 0 and self._records[place - 1].stamp_ns == stamp_ns

    def insert(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> Recut | Rejection:
        """Cut a late report and all later ones; refuse one that comes before all, or once more."""
        if self.reported(stamp_ns):
            return Rejection.DUPLICATE
        place = self._place(stamp_ns)
        later, kept = self._records[place:], self._turns.state
        last_ns = later[0].before.last_ns if later else None
        if last_ns is None or last_ns >= stamp_ns:
            return Rejection.LATE
        records, doubts = list(self._records), Counter(self._turns.doubts)
        del self._records[place:]
        self._turns.state = later[0].before
        reports = [(stamp_ns, detections, sector), *(own[:3] for own in later)]
        cut = [self.split(*report) for report in reports]
        # What is odd about the later ones was counted when they came.
        self._turns.doubts = doubts
        if any(isinstance(pieces, Rejection) for pieces in cut):
            self._turns.state, self._records = kept, records
            return Rejection.LATE
        return Recut(
            tuple(own_ns for record in later for own_ns, _ in record.pieces),
            tuple(piece for record in self._records[place:] for piece in record.pieces),
        )

    def forget_before(self, stamp_ns: int) -> None:
        """Forget reports at a stamp or before it."""
        del self._records[: self._place(stamp_ns)]

    def clear(self) -> None:
        """Forget all reports."""
        self._records = []

    def _place(self, stamp_ns: int) -> int:
        """Return the number of reports at a stamp or before it."""
        return bisect_right(self._records, stamp_ns, key=attrgetter("stamp_ns"))
