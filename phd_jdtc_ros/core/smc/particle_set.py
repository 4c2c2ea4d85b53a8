# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The particle set: a weighted approximation of the intensity over (state, class, motion mode)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, SparseArray, read_only, sum_by


@dataclass(frozen=True)
class ParticleSet:
    """A particle approximation of the intensity over (state, class, motion mode).

    After an update the posterior is a Poisson part and Bernoulli components, each one target at
    the most. The weight of a particle is split alike:
    ``weight = poisson + components.sum(axis=1)``. A component is what one detection explains, or
    all that has one origin; see `correction`.

    Parameters
    ----------
    state : array of shape (N, D)
        In the world frame; metres, metres per second, radians per second.
    mode : int array of shape (N,)
        Flat index into the mode space.
    origin : int array of shape (N,)
        What founded the particle's ancestry: a birth term at a scan, a detection, or a parent
        that it was spawned beside.
    parent : int array of shape (N,)
        Row of the ancestor in the stored set of the scan before; -1 for a birth.
    multiplicity : int array of shape (N,)
        How many equal copies the row stands for.
    poisson : array of shape (N,)
        Weight of no component.
    components : sparse array of shape (N, J)
        Weight in component j.
    label : int array of shape (J,)
        Origin that each component is the target of; -1 where it is a detection's.
    log_snr : array of shape (N,)
        What the amplitude model remembers, ln(1 + SNR); zeros where it remembers nothing.
    """

    state: FloatArray
    mode: IntArray
    origin: IntArray
    parent: IntArray
    multiplicity: IntArray
    poisson: FloatArray
    components: SparseArray
    label: IntArray
    log_snr: FloatArray

    def __post_init__(self) -> None:
        for name in ("state", "poisson", "log_snr"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("mode", "origin", "parent", "multiplicity", "label"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.state)

    @cached_property
    def weight(self) -> FloatArray:
        """Total weight of each particle, shape (N,); sums to the expected factorize of targets."""
        total: FloatArray = read_only(
            self.poisson + self.components @ np.ones(self.components.shape[1])
        )
        return total

    @cached_property
    def _entries(self) -> IntArray | None:
        """How many components each row has; None where all have one, as is usual."""
        factorize = np.diff(self.components.indptr)
        return None if (factorize == 1).all() else factorize

    def by_entry(self, of_row: FloatArray) -> FloatArray:
        """Return of each entry of the components the value of its row."""
        return of_row if self._entries is None else of_row.repeat(self._entries)

    @cached_property
    def component_mass(self) -> FloatArray:
        """Weight of each component, shape (J,)."""
        parts = self.components
        mass: FloatArray = read_only(sum_by(parts.indices, parts.data, parts.shape[1]))
        return mass

    @property
    def effective_sample_size(self) -> float:
        """Number of equally weighted copies that would be as informative."""
        square = float((self.weight**2 / np.maximum(self.multiplicity, 1)).sum())
        return float(self.weight.sum()) ** 2 / square if square > 0.0 else 0.0

    def class_mass(self, class_of: IntArray, classes: int) -> FloatArray:
        """Return the expected factorize of targets of each class, shape (C,).

        Parameters
        ----------
        class_of : int array of shape (O,)
            Class of each flat mode.
        classes : int
        """
        return sum_by(class_of[self.mode], self.weight, classes)

    @staticmethod
    def empty(state_size: int) -> ParticleSet:
        """Return an intensity of no targets."""
        none = np.zeros(0, dtype=np.int64)
        return ParticleSet(
            state=np.zeros((0, state_size)),
            mode=none,
            origin=none,
            parent=none,
            multiplicity=none,
            poisson=np.zeros(0),
            components=sparse.csr_array((0, 0)),
            label=none,
            log_snr=np.zeros(0),
        )
