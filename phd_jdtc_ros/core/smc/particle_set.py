"""The particle set: a weighted approximation of the intensity over (state, class, motion mode)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from scipy import sparse

from ..arrays import TINY, FloatArray, IntArray, ReadOnly, SparseArray, factorize, read_only, sum_by
from ..snapshot import MAX_INDEX, MAX_STATE, floats, integers, sparse_rows
from ..state_space import StateSpace
from ..window.entries import Extents

# Bound, in a snapshot, on the logarithm of a signal-to-noise ratio.
MAX_LOG_SNR = 100.0


@dataclass(frozen=True)
class ParticleSet(ReadOnly):
    """A particle approximation of the intensity over (state, class, motion mode).

    After an update the posterior is a Poisson part and Bernoulli components, each of at most one
    target. The weight of a particle is split accordingly:
    ``weight = poisson + components.sum(axis=1)``. With labels, a component is the mass of one
    label, and the Poisson part is zero. With the corrector of the PHD filter, a component is the
    mass that explains one detection. See `correction`.
    """

    # World frame; metres, metres per second, radians per second, (N, D).
    state: Annotated[FloatArray, floats("ND", -MAX_STATE, MAX_STATE)]
    mode: Annotated[IntArray, integers("N", 0, below="O")]  # Flat index into the mode space, (N,)
    # Label of the birth from which the particle descends, (N,): a birth term and scan, a detection,
    # or a parent and scan; see `labels`.
    row_label: Annotated[IntArray, integers("N", 0, key="origin")]
    # Row of the previous scan's stored set from which it was predicted, (N,); -1 for a birth.
    parent: Annotated[IntArray, integers("N", -1)]
    # Number of equal particles that the row represents, (N,).
    multiplicity: Annotated[IntArray, integers("N", 1)]
    # Weight outside all components, (N,).
    poisson: Annotated[FloatArray, floats("N", 0.0, MAX_INDEX)]
    # Weight in component j, (N, J).
    components: Annotated[SparseArray, sparse_rows("NJ", MAX_INDEX)]
    # Label of the component's target, (J,); -1 for the component of a detection.
    label: Annotated[IntArray, integers("J", -1)]
    # ln(1 + SNR) of each particle's target, (N,); zeros without the amplitude model `memory`.
    log_snr: Annotated[FloatArray, floats("N", -MAX_LOG_SNR, MAX_LOG_SNR)]

    def __len__(self) -> int:
        return len(self.state)

    @cached_property
    def weight(self) -> FloatArray:
        """Total weight of each particle, shape (N,); sums to the expected number of targets."""
        parts = self.components
        total: FloatArray = read_only(self.poisson + parts @ np.ones(parts.shape[1]))
        return total

    @cached_property
    def _entries(self) -> IntArray | None:
        """Number of components of each row; None in the usual case that each row has one."""
        count = np.diff(self.components.indptr)
        return None if (count == 1).all() else count

    def by_entry(self, row_value: FloatArray) -> FloatArray:
        """Return the values of rows expanded to the entries of the components."""
        return row_value if self._entries is None else row_value.repeat(self._entries)

    @cached_property
    def component_mass(self) -> FloatArray:
        """Weight of each component, shape (J,)."""
        parts = self.components
        mass: FloatArray = read_only(sum_by(parts.indices, parts.data, parts.shape[1]))
        return mass

    def take(self, rows: IntArray) -> ParticleSet:
        """Return the particles of these rows, with all weight in the Poisson part."""
        return ParticleSet.unassigned(
            self.state.take(rows, axis=0),
            self.mode[rows],
            self.row_label[rows],
            self.parent[rows],
            self.weight[rows],
            self.log_snr[rows],
            self.multiplicity[rows],
        )

    def scale(self, rows: IntArray, factor: FloatArray) -> ParticleSet:
        """Return the particles of these rows, with weights times `factor`, in all components."""
        return replace(
            self.take(rows),
            poisson=self.poisson[rows] * factor,
            components=scale_rows(self.components[rows], factor),
            label=self.label,
        )

    @property
    def effective_sample_size(self) -> float:
        """Effective sample size, at most N; copies count as one particle."""
        square = float(self.weight @ self.weight)
        if square == 0.0:
            return 0.0
        return min(float(self.weight.sum()) ** 2 / square, float(len(self)))

    @property
    def effective_share(self) -> float:
        """Effective share of a target's particles, 0 to 1; 1 if all have the same weight.

        This is the mean over the labels, weighted by their mass. The many particles of births have
        little mass, and so do not hide a target of few effective particles.
        """
        distinct, target = factorize(self.row_label)
        mass = sum_by(target, self.weight, len(distinct))
        square = sum_by(target, self.weight**2, len(distinct))
        share = mass**2 / np.where(square > 0.0, square * np.bincount(target), 1.0)
        total = float(mass.sum())
        return min(float(mass @ share) / total, 1.0) if total > 0.0 else 0.0

    def class_mass(
        self, class_of: IntArray, classes: int, rows: IntArray | None = None
    ) -> FloatArray:
        """Return the expected number of targets of each class; see `Rows.class_mass`."""
        if rows is None:
            return sum_by(class_of[self.mode], self.weight, classes)
        return sum_by(class_of[self.mode[rows]], self.weight[rows], classes)

    def copies(self, rows: IntArray | None = None) -> int:
        """Return the number of particles that these rows represent; None for all rows."""
        return int((self.multiplicity if rows is None else self.multiplicity[rows]).sum())

    def extents(self, space: StateSpace) -> Extents:
        """Return the position and extent of each label's particles."""
        label, target = factorize(self.row_label)
        weight = np.maximum(self.weight, TINY)
        share = weight / sum_by(target, weight, len(label)).take(target)

        def moments(axes: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
            columns = [self.state[:, axis] for axis in axes]
            mean = [sum_by(target, share * column, len(label)) for column in columns]
            square = sum(
                sum_by(target, share * (column - centre.take(target)) ** 2, len(label))
                for column, centre in zip(columns, mean, strict=True)
            )
            return np.stack(mean, axis=1), np.sqrt(square)

        position, position_std = moments(space.position)
        velocity, velocity_std = moments(space.velocity)
        deviations = position_std, velocity_std
        return Extents(label, target, np.column_stack([position, velocity, *deviations]))

    @staticmethod
    def unassigned(
        state: FloatArray,
        mode: IntArray,
        row_label: IntArray,
        parent: IntArray,
        weight: FloatArray,
        log_snr: FloatArray,
        multiplicity: IntArray | None = None,
    ) -> ParticleSet:
        """Return particles outside all components, by default of multiplicity one."""
        size = len(weight)
        return ParticleSet(
            state=state,
            mode=mode,
            row_label=row_label,
            parent=parent,
            multiplicity=np.ones(size, dtype=np.int64) if multiplicity is None else multiplicity,
            poisson=weight,
            components=sparse.csr_array((size, 0)),
            label=np.zeros(0, dtype=np.int64),
            log_snr=log_snr,
        )

    @staticmethod
    def empty(state_size: int) -> ParticleSet:
        """Return an intensity of no targets."""
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        return ParticleSet.unassigned(np.zeros((0, state_size)), none, none, none, nothing, nothing)

    @staticmethod
    def concatenate(parts: Sequence[ParticleSet]) -> ParticleSet:
        """Return the particles and the components of all parts, at least one."""
        columns = {
            column.name: np.concatenate([getattr(part, column.name) for part in parts])
            for column in fields(ParticleSet)
            if column.name != "components"
        }
        components = sparse.block_diag([part.components for part in parts], format="csr")
        return ParticleSet(components=components, **columns)


def scale_rows(matrix: SparseArray, factor: FloatArray) -> SparseArray:
    """Return a CSR array with each row multiplied by its factor; the pattern is shared."""
    data = matrix.data * factor.repeat(np.diff(matrix.indptr))
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


class AgedParticles(NamedTuple):
    """A stored set and its age."""

    particles: ParticleSet
    dt: float  # Time since its scan, seconds
