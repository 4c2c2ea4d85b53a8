"""Entries of the window: the set that an engine keeps of one scan, linked to earlier sets.

A scan of a turning radar updates only the targets that the antenna passed. Every label is then in
the set of the last scan that swept it, and a scan may continue rows of several earlier sets.

The engine defines a row: a particle, or one of the Gaussian hypotheses of a label.
"""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, Protocol, TypeVar

from ..arrays import BoolArray, FloatArray, IntArray
from ..state_space import PLANAR, StateSpace


class Extents(NamedTuple):
    """Position and velocity of the target of each label, with their spread."""

    label: IntArray  # Ascending, (T,)
    target: IntArray  # Index of each row's label in `label`, (N,)
    # Mean position and velocity, and the root mean square distances from them, metres and metres
    # per second, (T, 6).
    moments: FloatArray


class Rows(Sized, Protocol):
    """A set that approximates the intensity: N weighted rows, each with one label."""

    @property
    def row_label(self) -> IntArray:
        """Label of each row, shape (N,); see `labels`."""

    @property
    def label(self) -> IntArray:
        """Label of each component's target, shape (J,); -1 for a component without label."""

    def take(self: RowsT, rows: IntArray) -> RowsT:
        """Return the set of these rows."""

    def class_mass(
        self, class_of: IntArray, classes: int, rows: IntArray | None = None
    ) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,).

        Parameters
        ----------
        class_of : int array of shape (O,)
            Class of each flat mode.
        rows : int array or None
            The rows to count; None for all rows.
        """

    def extents(self, space: StateSpace) -> Extents:
        """Return the position and velocity of the target of each label."""


RowsT = TypeVar("RowsT", bound=Rows)
# The engine's data for the backward step from the rows of a set to the rows of its sources.
LinkT = TypeVar("LinkT")


@dataclass(frozen=True)
class Source:
    """The rows of an earlier set that a scan continues."""

    stamp_ns: int  # Stamp of the earlier set's scan
    rows: IntArray | None  # Continued rows, ascending; None for all rows
    size: int  # Number of rows


@dataclass(frozen=True)
class Entry(Generic[RowsT, LinkT]):
    """The set that an engine keeps of one scan."""

    stamp_ns: int
    stored: RowsT  # Rows of the labels that the scan swept or created
    # The earlier rows that these continue; empty if there are none.
    sources: tuple[Source, ...] = ()
    # Link from `stored` back to the concatenated rows of all sources; None without sources or
    # without smoothing.
    link: LinkT | None = None

    @property
    def unlinked(self) -> Entry[RowsT, LinkT]:
        """The entry without its link, for a window without its sources."""
        return self if self.link is None else Entry(self.stamp_ns, self.stored, self.sources)

    @cached_property
    def source_stamps(self) -> frozenset[int]:
        """The stamps of the sources."""
        return frozenset([source.stamp_ns for source in self.sources])

    @cached_property
    def label(self) -> IntArray:
        """Label of the target of each component of `stored`; see `Rows`."""
        return self.stored.label

    @cached_property
    def extents(self) -> Extents:
        """Position and velocity of the target of each label."""
        return self.stored.extents(PLANAR)


@dataclass(frozen=True)
class UnsweptRows(Generic[RowsT, LinkT]):
    """The rows of an entry that no later scan has swept."""

    entry: Entry[RowsT, LinkT]
    rows: IntArray | None = None  # These rows, ascending; None for all rows

    def __len__(self) -> int:
        return (self.entry.stored.row_label if self.rows is None else self.rows).size

    @property
    def stored(self) -> RowsT:
        """The set of these rows; computed at each call, because it is needed once."""
        return self.entry.stored if self.rows is None else self.entry.stored.take(self.rows)

    @property
    def row_label(self) -> IntArray:
        """Label of each of these rows."""
        label = self.entry.stored.row_label
        return label if self.rows is None else label[self.rows]

    def class_mass(self, class_of: IntArray, classes: int) -> FloatArray:
        """Return the rows' expected number of targets of each class; see `Rows.class_mass`."""
        return self.entry.stored.class_mass(class_of, classes, self.rows)

    @property
    def source(self) -> Source:
        """The rows as a source of a later scan."""
        return Source(self.entry.stamp_ns, self.rows, len(self))

    def split(
        self, swept: BoolArray
    ) -> tuple[UnsweptRows[RowsT, LinkT] | None, UnsweptRows[RowsT, LinkT] | None]:
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
