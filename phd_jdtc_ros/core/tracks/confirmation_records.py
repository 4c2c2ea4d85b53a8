"""Confirmation states of live tracks, and of filtered tracks whose stamps are not yet smoothed."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..snapshot import MAX_MASS, MAX_STAMP_NS, floats, integers
from ..types import COASTING, TENTATIVE

# Upper bound of counts and factors in a snapshot.
MAX_COUNT = 1e18


class ConfirmationRecords(NamedTuple):
    """Confirmation state of each live track, confirmed or not."""

    label: Annotated[IntArray, integers("T", 1, ascending=True)]  # Ascending, (T,)
    # `stamp_ns`, `detected_ns`: stamps of the last scan that swept the track, and of its last
    # detection, (T,).
    stamp_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    detected_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    # Existence probability at `stamp_ns`, (T,).
    existence: Annotated[FloatArray, floats("T", 0.0, MAX_MASS)]
    # `TENTATIVE`, `CONFIRMED` or `COASTING`, (T,).
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]
    # `expected`, `missed`: expected and actual number of missed detections since confirmation,
    # (T,).
    expected: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]
    missed: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]
    # Correction of the odds of existence for the misses since the last detection, (T,).
    factor: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]

    @staticmethod
    def of_none() -> ConfirmationRecords:
        """Return a table without tracks."""
        return ConfirmationRecords.new(np.zeros(0, dtype=np.int64), 0, np.zeros(0))

    @staticmethod
    def new(label: IntArray, stamp_ns: int, existence: FloatArray) -> ConfirmationRecords:
        """Return the records of new tracks."""
        size = len(label)
        stamps = np.full(size, stamp_ns, dtype=np.int64)
        tentative, none = np.full(size, TENTATIVE), np.zeros(size)
        return ConfirmationRecords(
            label, stamps, stamps, existence, tentative, none, none, np.ones(size)
        )

    def take(self, rows: IntArray) -> ConfirmationRecords:
        """Return the records of these rows."""
        return ConfirmationRecords._make(column[rows] for column in self)

    def merge(self, other: ConfirmationRecords) -> ConfirmationRecords:
        """Return the records of both, by ascending label."""
        every = ConfirmationRecords._make(map(np.concatenate, zip(self, other, strict=True)))
        return every.take(np.argsort(every.label, kind="stable"))

    def replace_rows(self, rows: IntArray, by: ConfirmationRecords) -> ConfirmationRecords:
        """Return the records with these rows replaced."""
        changed = ConfirmationRecords._make(column.copy() for column in self)
        for column, other in zip(changed, by, strict=True):
            column[rows] = other
        return changed


class PastStates(NamedTuple):
    """States of filtered tracks whose stamps may still be smoothed; all columns (T,)."""

    stamp_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    label: Annotated[IntArray, integers("T", 0)]
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]

    def at(self, stamp_ns: int) -> PastStates:
        """Return the rows of a stamp."""
        return PastStates(*(column[self.stamp_ns == stamp_ns] for column in self))

    def since(self, stamp_ns: int) -> PastStates:
        """Return the rows from a stamp on."""
        return PastStates(*(column[self.stamp_ns >= stamp_ns] for column in self))
