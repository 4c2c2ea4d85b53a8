"""Particles: a weighted approximation of the intensity over (state, class, motion mode)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, ReadOnly, SparseArray, read_only, sum_by


@dataclass(frozen=True)
class Particles(ReadOnly):
    """A set of particles; ``weight = poisson + components.sum(axis=1)`` for each of them.

    Sec. IV-C, the weighted particles of Step 1. Deviation: the weight is split into a Poisson part
    and one Bernoulli component for each detection of the scan.
    """

    # World frame; metres, metres per second, radians per second, (N, D).
    state: FloatArray
    mode: IntArray  # Flat index into the mode space, (N,)
    # Number of the birth from which the particle descends, by birth term and scan, (N,).
    origin: IntArray
    # Row of the previous stored set from which it was predicted, (N,); -1 for a birth.
    parent: IntArray
    multiplicity: IntArray  # Number of equal particles that the row stands for, (N,)
    poisson: FloatArray  # Weight that no detection explains, (N,)
    components: SparseArray  # Weight that detection j of the scan explains, CSR, (N, J)

    def __len__(self) -> int:
        return len(self.state)

    @cached_property
    def weight(self) -> FloatArray:
        """Total weight of each particle, shape (N,); sums to the expected number of targets."""
        total: FloatArray = read_only(self.poisson + self.components.sum(axis=1))
        return total

    def by_entry(self, row_value: FloatArray) -> FloatArray:
        """Return the values of rows expanded to the entries of the components."""
        return row_value.repeat(np.diff(self.components.indptr))

    def by_component(self, row_value: FloatArray) -> FloatArray:
        """Return for each component the sum over rows of weight times the row's value, (J,)."""
        parts = self.components
        return sum_by(parts.indices, parts.data * self.by_entry(row_value), parts.shape[1])

    def scaled(self, rows: IntArray, factor: FloatArray, multiplicity: IntArray) -> Particles:
        """Return the particles of these rows, with all parts of their weights times `factor`."""
        return Particles(
            state=self.state.take(rows, axis=0),
            mode=self.mode[rows],
            origin=self.origin[rows],
            parent=self.parent[rows],
            multiplicity=multiplicity,
            poisson=self.poisson[rows] * factor,
            components=scale_rows(self.components[rows], factor),
        )

    @property
    def effective_sample_size(self) -> float:
        """Effective sample size, at most N; copies count as one particle."""
        square = float(self.weight @ self.weight)
        return min(float(self.weight.sum()) ** 2 / square, float(len(self))) if square else 0.0

    @staticmethod
    def unexplained(
        state: FloatArray, mode: IntArray, origin: IntArray, parent: IntArray, weight: FloatArray
    ) -> Particles:
        """Return particles of multiplicity one whose weight is in the Poisson part."""
        single, none = np.ones(len(weight), dtype=np.int64), sparse.csr_array((len(weight), 0))
        return Particles(state, mode, origin, parent, single, weight, none)

    @staticmethod
    def empty(size: int) -> Particles:
        """Return an intensity of no targets, given the size of a state."""
        none = np.zeros(0, dtype=np.int64)
        return Particles.unexplained(np.zeros((0, size)), none, none, none, np.zeros(0))

    @staticmethod
    def concatenate(parts: Sequence[Particles]) -> Particles:
        """Return the particles of all parts, at least one, none of which has components."""
        names = ("state", "mode", "origin", "parent", "poisson")
        columns = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
        return Particles.unexplained(*columns)

    def explained_by(self, missed: FloatArray, assigned: SparseArray) -> Particles:
        """Return the particles after a report of M detections: M components are added.

        `missed` is the factor of each particle on what it had before, (N,), and `assigned` has the
        new components, (N, M).
        """
        kept = scale_rows(self.components, missed)
        components = sparse.hstack([kept, assigned], format="csr")
        return replace(self, poisson=self.poisson * missed, components=components)


def scale_rows(matrix: SparseArray, factor: FloatArray) -> SparseArray:
    """Return a CSR array with each row multiplied by its factor; the pattern is shared."""
    data = matrix.data * factor.repeat(np.diff(matrix.indptr))
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)
