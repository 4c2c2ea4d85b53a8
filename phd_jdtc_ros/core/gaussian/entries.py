"""Entries of the window: the mixture that is kept of one scan, linked to earlier mixtures.

A scan of a turning radar updates only the targets that the antenna passed. Every label is then in
the mixture of the last scan that swept it, and a scan may continue rows of several earlier ones. A
row is one of the hypotheses of a label.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from ..arrays import BoolArray, FloatArray, IntArray
from ..state_space import PLANAR
from .mixture import Extents, Mixture
from .prediction import Moves
from .reduction import Ancestry


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses."""

    # From the earlier hypotheses of all sources of the scan, concatenated, to the predicted ones.
    moves: Moves
    ancestry: Ancestry  # From the predicted hypotheses to the kept ones


@dataclass(frozen=True)
class Source:
    """The rows of an earlier set that a scan continues."""

    stamp_ns: int  # Stamp of the earlier set's scan
    rows: IntArray | None  # Continued rows, ascending; None for all rows
    size: int  # Number of rows


@dataclass(frozen=True)
class Entry:
    """The mixture that is kept of one scan."""

    stamp_ns: int
    stored: Mixture  # Rows of the labels that the scan swept or created
    # The earlier rows that these continue; empty if there are none.
    sources: tuple[Source, ...] = ()
    # Link from `stored` back to the concatenated rows of all sources; None without sources or
    # without smoothing.
    link: Link | None = None

    @property
    def unlinked(self) -> Entry:
        """The entry without its link, for a window without its sources."""
        return self if self.link is None else Entry(self.stamp_ns, self.stored, self.sources)

    @cached_property
    def source_stamps(self) -> frozenset[int]:
        """The stamps of the earlier entries that this one continues, nanoseconds."""
        return frozenset([source.stamp_ns for source in self.sources])

    @cached_property
    def label(self) -> IntArray:
        """Label of each target, ascending, (T,)."""
        return self.stored.sums.label

    @cached_property
    def extents(self) -> Extents:
        """Position and velocity of the target of each label."""
        return self.stored.extents(PLANAR)


@dataclass(frozen=True)
class UnsweptRows:
    """The rows of an entry that no later scan has swept."""

    entry: Entry
    rows: IntArray | None = None  # These rows, ascending; None for all rows

    def __len__(self) -> int:
        return (self.entry.stored.row_label if self.rows is None else self.rows).size

    @property
    def stored(self) -> Mixture:
        """The set of these rows; computed at each call, because it is needed once."""
        return self.entry.stored if self.rows is None else self.entry.stored.take(self.rows)

    @property
    def row_label(self) -> IntArray:
        """Label of the target of each of these rows, (N,)."""
        label = self.entry.stored.row_label
        return label if self.rows is None else label[self.rows]

    def class_mass(self) -> FloatArray:
        """Return the rows' expected number of targets of each class; see `Mixture.class_mass`."""
        return self.entry.stored.class_mass(self.rows)

    @property
    def source(self) -> Source:
        """The rows as a source of a later scan."""
        return Source(self.entry.stamp_ns, self.rows, len(self))

    def split(self, swept: BoolArray) -> tuple[UnsweptRows | None, UnsweptRows | None]:
        """Return the swept rows and the other rows; None for an empty part.

        Parameters
        ----------
        swept : bool array of shape (N,)
            Whether a scan has swept each row of the entry.
        """
        is_swept = swept if self.rows is None else swept[self.rows]
        (rows,) = is_swept.nonzero()
        if rows.size == is_swept.size:
            return self, None
        if not rows.size:
            return None, self
        (others,) = (~is_swept).nonzero()
        if self.rows is not None:
            rows, others = self.rows[rows], self.rows[others]
        return UnsweptRows(self.entry, rows), UnsweptRows(self.entry, others)


def trim(
    window: list[Entry],
    unswept: Sequence[UnsweptRows],
    following: int,
) -> list[Entry]:
    """Return the entries that the filter or a pending stamp, from `following` on, needs."""
    dropped = {entry.stamp_ns for entry in window if entry.stamp_ns < following}
    dropped.difference_update(
        [rows.entry.stamp_ns for rows in unswept],
        *[entry.source_stamps for entry in window if entry.stamp_ns > following],
    )
    if not dropped:
        return window
    remaining = [entry for entry in window if entry.stamp_ns not in dropped]
    stamps = {entry.stamp_ns for entry in remaining}
    return [entry if entry.source_stamps & stamps else entry.unlinked for entry in remaining]
