"""Keeps the latest reports of a turning radar, so that a late one is cut as if it were on time.

The coverage of a report follows from the reports before it. After a late report has been inserted,
the later ones are cut again.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from typing import NamedTuple

from ..types import Detections
from .scans import Rejection
from .turns import Piece, State, Turns


class _Record(NamedTuple):
    """A report, the state before it, and its parts."""

    stamp_ns: int
    detections: Detections
    sector: int | None
    before: State
    pieces: list[Piece]


class Recut(NamedTuple):
    """The changes by a late report.

    Parameters
    ----------
    stamps_ns : list of int
        Stamps of the parts that are replaced.
    pieces : list of (stamp in nanoseconds, Detections)
        The parts of the late report and of all later ones, by ascending stamp.
    """

    stamps_ns: list[int]
    pieces: list[Piece]


class TurnHistory:
    """Cuts the reports of one radar, and can do so again with a late one; see `Turns.split`."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._records: list[_Record] = []

    def split(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Piece] | Rejection:
        """Return the parts of a report that is not late."""
        before = self._turns.state
        pieces = self._turns.split(stamp_ns, detections, sector)
        if self._turns.state is not before and not isinstance(pieces, Rejection):
            if self._records and stamp_ns < self._records[-1].stamp_ns:
                self._records.clear()  # of another run
            self._records.append(_Record(stamp_ns, detections, sector, before, pieces))
        return pieces

    def later(self, stamp_ns: int) -> int | Rejection:
        """Return the number of reports after a late one, or why it cannot be inserted.

        It cannot if it is a duplicate, or older than all that are kept.
        """
        place = self._place(stamp_ns)
        if place and self._records[place - 1].stamp_ns == stamp_ns:
            return Rejection.DUPLICATE
        later = self._records[place:]
        last_ns = later[0].before.last_ns if later else None
        return Rejection.LATE if last_ns is None or last_ns >= stamp_ns else len(later)

    def insert(self, stamp_ns: int, detections: Detections, sector: int | None) -> Recut:
        """Insert a late report that `later` accepts, and cut all later ones again."""
        place = self._place(stamp_ns)
        later = self._records[place:]
        del self._records[place:]
        doubts, self._turns.state = Counter(self._turns.doubts), later[0].before
        for report in ((stamp_ns, detections, sector), *(record[:3] for record in later)):
            self.split(*report)
        # The warnings about the later reports were counted when they came.
        self._turns.doubts = doubts
        return Recut(
            [own_ns for record in later for own_ns, _ in record.pieces],
            [piece for record in self._records[place:] for piece in record.pieces],
        )

    def forget_before(self, stamp_ns: int) -> None:
        """Forget reports at a stamp or before it."""
        del self._records[: self._place(stamp_ns)]

    def clear(self) -> None:
        """Forget all reports."""
        self._records.clear()

    def _place(self, stamp_ns: int) -> int:
        """Return the number of reports at a stamp or before it."""
        return bisect_right(self._records, stamp_ns, key=lambda record: record.stamp_ns)
