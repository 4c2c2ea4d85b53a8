# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Storage of particle sets and transitions as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from scipy import sparse

from ..arrays import SparseArray
from ..snapshot import Snapshot
from .backward_kernel import Transition
from .particle_set import ParticleSet

PARTS = tuple(f.name for f in fields(ParticleSet) if f.name != "components")


def put_particles(snapshot: Snapshot, name: str, particles: ParticleSet) -> None:
    """Store a particle set."""
    for part in PARTS:
        snapshot.arrays[f"{name}.{part}"] = getattr(particles, part)
    _put_sparse(snapshot, f"{name}.components", particles.components)


def take_particles(snapshot: Snapshot, name: str) -> ParticleSet:
    """Return a stored particle set.

    Raises
    ------
    ValueError
        If the shapes of its arrays do not match.
    """
    parts = {part: snapshot.array(f"{name}.{part}") for part in PARTS}
    components = _take_sparse(snapshot, f"{name}.components", sparse.csr_array)
    rows = {part: len(array) for part, array in parts.items() if part != "label"}
    if {*rows.values(), components.shape[0]} != {len(parts["state"])}:
        raise ValueError(f"{name}: arrays of different length, {rows}")
    if components.shape[1] != len(parts["label"]):
        raise ValueError(f"{name}: {components.shape[1]} components, {len(parts['label'])} labels")
    return ParticleSet(components=components, **parts)


def put_transition(snapshot: Snapshot, name: str, link: Transition) -> None:
    """Store the transition between two particle sets."""
    snapshot.arrays[f"{name}.survival"] = link.survival
    snapshot.arrays[f"{name}.orphans"] = np.array(link.orphans)
    _put_sparse(snapshot, f"{name}.ratio", link.ratio)


def take_transition(
    snapshot: Snapshot, name: str, earlier: ParticleSet, later: ParticleSet
) -> Transition:
    """Return a stored transition.

    Raises
    ------
    ValueError
        If its shape does not match the sizes of the sets.
    """
    ratio = _take_sparse(snapshot, f"{name}.ratio", sparse.csc_array)
    survival = snapshot.array(f"{name}.survival")
    if ratio.shape != (len(earlier), len(later)) or len(survival) != len(earlier):
        raise ValueError(
            f"{name}: {ratio.shape} and {len(survival)} rows, expected "
            f"({len(earlier)}, {len(later)}) and {len(earlier)}"
        )
    return Transition(ratio, survival, int(snapshot.array(f"{name}.orphans")))


def _put_sparse(snapshot: Snapshot, name: str, matrix: SparseArray) -> None:
    for part in ("data", "indices", "indptr"):
        snapshot.arrays[f"{name}.{part}"] = getattr(matrix, part)
    snapshot.arrays[f"{name}.shape"] = np.array(matrix.shape, dtype=np.int64)


def _take_sparse(snapshot: Snapshot, name: str, kind: Any) -> Any:
    parts = tuple(snapshot.array(f"{name}.{part}") for part in ("data", "indices", "indptr"))
    matrix = kind(parts, shape=tuple(snapshot.array(f"{name}.shape").tolist()))
    matrix.check_format()
    return matrix
