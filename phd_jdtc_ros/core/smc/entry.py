# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the filter keeps of one scan, and how it is linked to the scans before.

A scan of a radar that turns updates the targets that the antenna passed, and leaves the others
alone. Every origin is then in the set of the last scan that touched it, and a scan may continue
rows of several earlier sets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray, factorize, read_only, sum_by
from ..state_space import StateSpace
from .backward_kernel import Transition
from .particle_set import ParticleSet


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
class Extents:
    """Where each origin's particles are.

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


@dataclass(frozen=True)
class Entry:
    """The set that the filter keeps of one scan.

    Parameters
    ----------
    stamp_ns : int
    stored : ParticleSet
        After resampling: the origins that the scan touched, and those that it began.
    sources : tuple of Source
        Where its rows come from; empty if from nowhere.
    link : Transition or None
        Backward kernel from the rows of all sources, one source after the other, to `stored`; None
        without sources and without smoothing.
    """

    stamp_ns: int
    stored: ParticleSet
    sources: tuple[Source, ...] = ()
    link: Transition | None = None

    @property
    def unlinked(self) -> Entry:
        """The entry without its link, for a window that holds none of its sources."""
        return self if self.link is None else replace(self, link=None)

    @cached_property
    def origins(self) -> tuple[IntArray, IntArray]:
        """The distinct origins, ascending, and the index of each row's origin in them."""
        origin, row_origin = factorize(self.stored.origin)
        return read_only(origin, np.int64), read_only(row_origin, np.int64)

    @cached_property
    def _extents(self) -> dict[StateSpace, Extents]:
        return {}

    def extents(self, space: StateSpace) -> Extents:
        """Return where each origin's particles are; computed once."""
        if space not in self._extents:
            self._extents[space] = self._measured(space)
        return self._extents[space]

    def _measured(self, space: StateSpace) -> Extents:
        origin, row_origin = self.origins
        weight = np.maximum(self.stored.weight, np.finfo(float).tiny)
        share = weight / sum_by(row_origin, weight, len(origin)).take(row_origin)

        def moments(axes: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
            columns = [self.stored.state[:, axis] for axis in axes]
            mean = [sum_by(row_origin, share * column, len(origin)) for column in columns]
            square = sum(
                sum_by(row_origin, share * (column - centre.take(row_origin)) ** 2, len(origin))
                for column, centre in zip(columns, mean, strict=True)
            )
            return np.stack(mean, axis=1), np.sqrt(square)

        position, position_std = moments(space.position)
        velocity, velocity_std = moments(space.velocity)
        return Extents(origin, row_origin, position, velocity, position_std, velocity_std)


@dataclass(frozen=True)
class Current:
    """An entry with rows that no later scan has touched.

    Parameters
    ----------
    entry : Entry
    rows : int array or None
        Those rows, ascending; None for all of them.
    """

    entry: Entry
    rows: IntArray | None = None

    def __len__(self) -> int:
        return len(self.entry.stored) if self.rows is None else len(self.rows)

    @cached_property
    def particles(self) -> ParticleSet:
        """The rows' particles."""
        return self.entry.stored if self.rows is None else self.entry.stored.take(self.rows)

    @cached_property
    def copies(self) -> int:
        """Number of particles that the rows stand for."""
        multiplicity = self.entry.stored.multiplicity
        return int((multiplicity if self.rows is None else multiplicity[self.rows]).sum())

    def class_mass(self, class_of: IntArray, classes: int) -> FloatArray:
        """Return the rows' expected number of targets of each class; see `ParticleSet`."""
        stored = self.entry.stored
        if self.rows is None:
            return stored.class_mass(class_of, classes)
        return sum_by(class_of[stored.mode[self.rows]], stored.weight[self.rows], classes)

    @property
    def source(self) -> Source:
        """The rows as a source of a later scan."""
        return Source(self.entry.stamp_ns, self.rows, len(self))

    def parted(self, touched: IntArray) -> tuple[Current | None, Current | None]:
        """Return the rows of some origins, and the other rows; None where there are none.

        Parameters
        ----------
        touched : bool array of shape (T,)
            By distinct origin of the entry.
        """
        row_origin = self.entry.origins[1]
        every = np.arange(len(row_origin)) if self.rows is None else self.rows
        chosen = touched[row_origin[every]]
        if chosen.all():
            return self, None
        if not chosen.any():
            return None, self
        return Current(self.entry, every[chosen]), Current(self.entry, every[~chosen])
