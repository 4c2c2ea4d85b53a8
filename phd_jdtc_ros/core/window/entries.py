"""What an engine keeps of one scan, and how it is linked to the scans before.

A scan of a radar that turns updates the targets that the antenna passed, and leaves the others
alone. Every origin is then in the set of the last scan that touched it, and a scan may continue
rows of several earlier sets.

What a row is, the engine says: a particle, or a Gaussian that is one of several of its origin.
"""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from ..state_space import StateSpace

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Extents:
    """Where the targets of each origin are.

    Parameters
    ----------
    origin : int array of shape (T,)
        Ascending.
    row_origin : int array of shape (N,)
        The index of each row's origin.
    position, velocity : arrays of shape (T, 2)
        Means, metres and metres per second.
    position_std, velocity_std : arrays of shape (T,)
        Root mean square distances from the means.
    """

    origin: IntArray
    row_origin: IntArray
    position: FloatArray
    velocity: FloatArray
    position_std: FloatArray
    velocity_std: FloatArray


class Rows(Sized, Protocol):
    """A set that approximates the intensity: N weighted rows, each of one origin."""

    @property
    def origin(self) -> IntArray:
        """Origin of each row, shape (N,); see `labels`."""
        ...

    @property
    def label(self) -> IntArray:
        """Origin of the target that each component is, shape (J,); -1 where it is of none."""
        ...

    def take(self: RowsT, rows: IntArray) -> RowsT:
        """Return the set of these rows."""
        ...

    def class_mass(
        self, class_of: IntArray, classes: int, rows: IntArray | None = None
    ) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,).

        Parameters
        ----------
        class_of : int array of shape (O,)
            Class of each flat mode.
        classes : int
        rows : int array or None
            Only these; None for all of them.
        """
        ...

    def extents(self, space: StateSpace) -> Extents:
        """Return where the targets of each origin are."""
        ...


RowsT = TypeVar("RowsT", bound=Rows)
# What an engine needs to go back from the rows of a set to those of its sources.
LinkT = TypeVar("LinkT")


@dataclass(frozen=True)
class Source:
    """The rows of an earlier set that a scan continues.

    Parameters
    ----------
    stamp_ns : int
        Of the earlier set's scan.
    rows : int array or None
        Ascending; None for all of them.
    size : int
        Number of rows.
    """

    stamp_ns: int
    rows: IntArray | None
    size: int


@dataclass(frozen=True)
class Entry(Generic[RowsT, LinkT]):
    """The set that an engine keeps of one scan.

    Parameters
    ----------
    stamp_ns : int
    stored : Rows
        The origins that the scan touched, and those that it began.
    sources : tuple of Source
        Where its rows come from; empty if from nowhere.
    link : object or None
        Leads from `stored` back to the rows of all sources, one source after the other; None
        without sources and without smoothing.
    """

    stamp_ns: int
    stored: RowsT
    sources: tuple[Source, ...] = ()
    link: LinkT | None = None

    @property
    def unlinked(self) -> Entry[RowsT, LinkT]:
        """The entry without its link, for a window that holds none of its sources."""
        return self if self.link is None else replace(self, link=None)

    @cached_property
    def _extents(self) -> dict[StateSpace, Extents]:
        return {}

    def extents(self, space: StateSpace) -> Extents:
        """Return where the targets of each origin are; computed once."""
        if space not in self._extents:
            self._extents[space] = self.stored.extents(space)
        return self._extents[space]


@dataclass(frozen=True)
class Current(Generic[RowsT, LinkT]):
    """An entry with rows that no later scan has touched.

    Parameters
    ----------
    entry : Entry
    rows : int array or None
        Those rows, ascending; None for all of them.
    """

    entry: Entry[RowsT, LinkT]
    rows: IntArray | None = None

    def __len__(self) -> int:
        return len(self.entry.stored) if self.rows is None else len(self.rows)

    @cached_property
    def stored(self) -> RowsT:
        """The set of these rows."""
        return self.entry.stored if self.rows is None else self.entry.stored.take(self.rows)

    @property
    def origin(self) -> IntArray:
        """Origin of each of these rows."""
        origin = self.entry.stored.origin
        return origin if self.rows is None else origin[self.rows]

    @cached_property
    def _class_mass(self) -> dict[int, FloatArray]:
        return {}

    def class_mass(self, class_of: IntArray, classes: int) -> FloatArray:
        """Return the rows' expected number of targets of each class; computed once.

        See `Rows.class_mass`. The flat modes of a number of classes are always the same.
        """
        if classes not in self._class_mass:
            mass = self.entry.stored.class_mass(class_of, classes, self.rows)
            self._class_mass[classes] = mass
        return self._class_mass[classes]

    @property
    def source(self) -> Source:
        """The rows as a source of a later scan."""
        return Source(self.entry.stamp_ns, self.rows, len(self))

    def split(
        self, touched: BoolArray
    ) -> tuple[Current[RowsT, LinkT] | None, Current[RowsT, LinkT] | None]:
        """Return the rows that are touched, and the other rows; None where there are none.

        Parameters
        ----------
        touched : bool array of shape (N,)
            By row of the entry.
        """
        every = np.arange(len(touched)) if self.rows is None else self.rows
        chosen = touched[every]
        if chosen.all():
            return self, None
        if not chosen.any():
            return None, self
        return Current(self.entry, every[chosen]), Current(self.entry, every[~chosen])
