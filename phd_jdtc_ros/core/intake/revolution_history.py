"""Keeps the latest reports of a turning radar, to insert out-of-sequence reports.

The coverage of a report follows from the reports before it. After an out-of-sequence report has
been inserted, the later ones are cut again.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from typing import NamedTuple

from ..types import Detections
from .revolutions import Revolutions, State
from .scans import Rejection
from .sectors import Slice


class _Record(NamedTuple):
    """A report, the state before it, and its slices."""

    stamp_ns: int
    detections: Detections
    sector: int | None
    before: State
    slices: list[Slice]


class Recut(NamedTuple):
    """The changes by an out-of-sequence report."""

    stamps_ns: list[int]  # Stamps of the slices that are replaced
    # Slices of the out-of-sequence report and of all later ones, by ascending stamp.
    slices: list[Slice]


class RevolutionHistory:
    """Cuts the reports of one radar, and inserts out-of-sequence reports; see `Revolutions.split`.

    None can be inserted unless reports are `kept`.
    """

    def __init__(self, revolutions: Revolutions, kept: bool = True) -> None:
        self.revolutions, self.kept = revolutions, kept
        self._records: list[_Record] = []

    def split(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Slice] | Rejection:
        """Return the slices of a report that is in sequence."""
        before = self.revolutions.state
        slices = self.revolutions.split(stamp_ns, detections, sector)
        if isinstance(slices, Rejection):
            return slices
        if self.kept and self.revolutions.state is not before:
            if self._records and stamp_ns < self._records[-1].stamp_ns:
                self._records.clear()  # It is of another run
            self._records.append(_Record(stamp_ns, detections, sector, before, slices))
        return slices

    def count_later(self, stamp_ns: int) -> int | Rejection:
        """Return the number of reports after an out-of-sequence one, or why it cannot be inserted.

        It cannot if it is a duplicate, or older than all that are kept.
        """
        index = self._index(stamp_ns)
        if index and self._records[index - 1].stamp_ns == stamp_ns:
            return Rejection.DUPLICATE
        later = self._records[index:]
        last_ns = later[0].before.last_ns if later else None
        return Rejection.LATE if last_ns is None or last_ns >= stamp_ns else len(later)

    def insert(self, stamp_ns: int, detections: Detections, sector: int | None) -> Recut:
        """Insert a report that `count_later` accepts, and cut all later ones again."""
        index = self._index(stamp_ns)
        later = self._records[index:]
        del self._records[index:]
        anomalies, self.revolutions.state = Counter(self.revolutions.anomalies), later[0].before
        for report in ((stamp_ns, detections, sector), *(record[:3] for record in later)):
            self.split(*report)
        # The anomalies of the later reports were counted when they came.
        self.revolutions.anomalies = anomalies
        return Recut(
            [own_ns for record in later for own_ns, _ in record.slices],
            [slice_ for record in self._records[index:] for slice_ in record.slices],
        )

    def forget_before(self, stamp_ns: int) -> None:
        """Forget reports at a stamp or before it."""
        del self._records[: self._index(stamp_ns)]

    def clear(self) -> None:
        """Forget all reports."""
        self._records.clear()

    def _index(self, stamp_ns: int) -> int:
        """Return the index of the first report after a stamp."""
        return bisect_right(self._records, stamp_ns, key=lambda record: record.stamp_ns)
