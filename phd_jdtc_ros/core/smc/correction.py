# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The two correctors: rules by which one radar's detections change the intensity.

`POISSON` is the corrector of the PHD filter (Sec. IV-C, Step 2). Targets are a Poisson process: the
mass at one place may claim any number of detections, and a missed detection scales it down by
1 - p_D. `BERNOULLI` takes the particles of one origin as at most one target, which claims at most
one detection. After a missed detection its existence probability is that of Bayes' rule.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, factorize, sum_by
from ..association.marginals import marginals
from .particle_set import ParticleSet

# Lower bound of the probability that a target is missed; odds are divided by it.
LEAST_MISSED = 1e-6
# Above this many a table of all cells would take more memory than the pairs that are sorted.
LARGEST_TABLE = 1 << 23


@dataclass(frozen=True)
class Claims:
    """How well particles and all other sources explain one radar's M detections.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        The particle and the detection of each pair within the gate.
    mass : array of shape (P,)
        p_D L_z w of each pair, divided by a scale of its detection.
    other : array of shape (M,)
        Intensity of clutter and unknown targets, divided by the same scale.
    detection_probability : array of shape (N,)
        p_D of each particle; 0 beyond the radar's range.
    """

    row: IntArray
    column: IntArray
    mass: FloatArray
    other: FloatArray
    detection_probability: FloatArray


class Correction(Protocol):
    """The rule by which one radar's detections change the intensity."""

    def __call__(self, particles: ParticleSet, claims: Claims) -> tuple[ParticleSet, FloatArray]:
        """Return the corrected intensity, and the claimed share of each detection, (M,)."""
        ...


@dataclass(frozen=True)
class Corrector:
    """A correction, and whether origins are targets under it.

    Parameters
    ----------
    correct : Correction
    labelled : bool
        Whether an origin is at most one target, so that the origin is the target's label.
    """

    correct: Correction
    labelled: bool


def _poisson(particles: ParticleSet, claims: Claims) -> tuple[ParticleSet, FloatArray]:
    """Correct as the PHD filter does; every detection has a component.

    Earlier components are multiplied by 1 - p_D, and M new ones are added.

    Notes
    -----
    Sec. IV-C, Step 2.
    """
    size = len(claims.other)
    claimed = sum_by(claims.column, claims.mass, size)
    total = claims.other + claimed
    total = np.where(total > 0.0, total, 1.0)
    part = sparse.csr_array(
        (claims.mass / total.take(claims.column), (claims.row, claims.column)),
        shape=(len(particles), size),
    )
    missed = 1.0 - claims.detection_probability
    corrected = replace(
        particles,
        poisson=particles.poisson * missed,
        components=sparse.hstack([scale_rows(particles.components, missed), part], format="csr"),
        label=np.concatenate([particles.label, np.full(size, -1)]),
    )
    return corrected, claimed / total


def _bernoulli(particles: ParticleSet, claims: Claims) -> tuple[ParticleSet, FloatArray]:
    """Correct every origin as at most one target; every origin is a component.

    Notes
    -----
    Deviation from Sec. IV-C, Step 2: let r be the probability that the target exists, r p_D that it
    is detected, and p_z and p_0 the marginal probabilities of its association with detection z and
    with none. Then
    w <- w [p_0 (1 - p_D) / (1 - r p_D) + sum_z p_z p_D L_z / sum_s p_D L_z w].
    The posterior is a labelled multi-Bernoulli density, with the origins as labels.

    References
    ----------
    Meyer et al., "Message passing algorithms for scalable multitarget tracking", Proceedings of
    the IEEE 106(2), 2018, for the same marginals in a particle filter of Bernoulli targets.
    """
    origins, target = factorize(particles.origin)
    count, size = len(origins), len(claims.other)
    # Resampling may round a mass to a little more than one.
    excess = np.maximum(sum_by(target, particles.weight, count), 1.0)
    prior = particles.weight / excess.take(target)
    detected = sum_by(target, prior * claims.detection_probability, count)
    missed = np.maximum(1.0 - detected, LEAST_MISSED)

    edge, edge_of_pair = _edges((target * size).take(claims.row) + claims.column, count * size)
    edge_target, column = edge // max(size, 1), edge % max(size, 1)
    explained = sum_by(edge_of_pair, claims.mass, len(edge)) / excess[edge_target]
    odds = explained / missed[edge_target]
    probability, none = marginals(edge_target, column, odds, count, claims.other)

    scale = probability / np.where(explained > 0.0, explained, 1.0) / excess[edge_target]
    weight = prior * (1.0 - claims.detection_probability) * (none / missed).take(target)
    weight += sum_by(claims.row, claims.mass * scale.take(edge_of_pair), len(particles))
    corrected = replace(
        particles,
        poisson=np.zeros(len(particles)),
        components=sparse.csr_array(
            (weight, target, np.arange(len(particles) + 1)), shape=(len(particles), count)
        ),
        label=origins,
    )
    return corrected, np.minimum(sum_by(column, probability, size), 1.0)


def _edges(cell: IntArray, cells: int) -> tuple[IntArray, IntArray]:
    """Return the distinct cells, ascending, and the index of each entry's cell among them.

    A table of all cells replaces the sort of `numpy.unique`, which takes half of the time of an
    update with many targets.
    """
    if cells > LARGEST_TABLE:
        found, place = np.unique(cell, return_inverse=True)
        return found, place.ravel()
    table = np.zeros(cells, dtype=np.int64)
    table[cell] = 1
    distinct: IntArray = np.flatnonzero(table)
    table[distinct] = np.arange(len(distinct))
    return distinct, table.take(cell)


def scale_rows(matrix: sparse.csr_array, factor: FloatArray) -> sparse.csr_array:
    """Return a CSR array with each row multiplied by its factor; the pattern is shared."""
    data = matrix.data * factor.repeat(np.diff(matrix.indptr))
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


BERNOULLI = Corrector(_bernoulli, labelled=True)
POISSON = Corrector(_poisson, labelled=False)
CORRECTORS = {"bernoulli": BERNOULLI, "poisson": POISSON}
