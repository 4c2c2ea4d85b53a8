# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Storage of particle sets and transitions as arrays of a snapshot, and their restoration.

A snapshot may come from a forged file: every value is checked against what the tracker itself could
have stored, so that none of them ends it or becomes an estimate.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..arrays import SparseArray
from ..models.modes import ModeSpace
from ..snapshot import Snapshot
from .backward_kernel import Transition
from .particle_set import ParticleSet

AnyArray = npt.NDArray[Any]
# Of any component of a state: metres, metres per second, radians per second.
MOST_STATE = 1e9
MOST_LOG_SNR = 100.0
# Of origins and rows; far from where sums of them overflow.
MOST_INDEX = 1 << 60
# How much more than the budget a set may have: groups that survive by lot come on top.
SLACK = 4
# The draw of a kernel's entries is right on the average only.
MASS_SLACK = 100.0
PARTS = tuple(f.name for f in fields(ParticleSet) if f.name != "components")


def put_particles(snapshot: Snapshot, name: str, particles: ParticleSet) -> None:
    """Store a particle set."""
    for part in PARTS:
        snapshot.arrays[f"{name}.{part}"] = getattr(particles, part)
    _put_sparse(snapshot, f"{name}.components", particles.components)


def take_particles(snapshot: Snapshot, name: str, modes: ModeSpace, most: int) -> ParticleSet:
    """Return a stored particle set.

    Parameters
    ----------
    snapshot : Snapshot
    name : str
    modes : ModeSpace
        Of the tracker that goes on from it.
    most : int
        Particles that it may have.

    Raises
    ------
    ValueError
        If the shapes of its arrays do not match, or a value is not one of these modes' tracker.
    """
    parts = {part: snapshot.array(f"{name}.{part}") for part in PARTS}
    for part, array in parts.items():
        wanted = 2 if part == "state" else 1
        if array.ndim != wanted:
            raise ValueError(f"{name}.{part}: {array.ndim} axes, expected {wanted}")
    components = _take_sparse(snapshot, f"{name}.components", sparse.csr_array)
    rows = {part: len(array) for part, array in parts.items() if part != "label"}
    if {*rows.values(), components.shape[0]} != {len(parts["state"])}:
        raise ValueError(f"{name}: arrays of different length, {rows}")
    if components.shape[1] != len(parts["label"]):
        raise ValueError(f"{name}: {components.shape[1]} components, {len(parts['label'])} labels")
    if parts["state"].shape[1] != len(modes.space):
        raise ValueError(f"{name}.state: {parts['state'].shape[1]} axes per state")
    _require_numbers(f"{name}.state", parts["state"], -MOST_STATE, MOST_STATE)
    _require_numbers(f"{name}.log_snr", parts["log_snr"], -MOST_LOG_SNR, MOST_LOG_SNR)
    _require_whole(f"{name}.mode", parts["mode"], 0, len(modes) - 1)
    _require_whole(f"{name}.origin", parts["origin"], 0, MOST_INDEX)
    _require_whole(f"{name}.parent", parts["parent"], -1, MOST_INDEX)
    _require_whole(f"{name}.multiplicity", parts["multiplicity"], 1, SLACK * most)
    _require_whole(f"{name}.label", parts["label"], -1, MOST_INDEX)
    # There is at least about one particle a target.
    _require_numbers(f"{name}.poisson", parts["poisson"], 0.0, SLACK * most)
    _require_numbers(f"{name}.components.data", components.data, 0.0, SLACK * most)
    mass = float(parts["poisson"].sum() + components.data.sum())
    copies = int(parts["multiplicity"].astype(np.float64).sum())
    if copies > SLACK * most or mass > SLACK * most:
        raise ValueError(f"{name}: {copies} particles of mass {mass:.3g}, at most {SLACK * most}")
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
    _require_numbers(f"{name}.survival", survival, 0.0, 1.0)
    _require_numbers(f"{name}.ratio.data", ratio.data, 0.0, np.inf)
    orphans = snapshot.array(f"{name}.orphans")
    _require_whole(f"{name}.orphans", orphans, 0, len(later))
    # What later targets are traced back to is no more than there is of them.
    with np.errstate(over="ignore", invalid="ignore"):
        traced = float(earlier.weight @ (ratio @ later.weight))
    if not traced <= MASS_SLACK * (1.0 + float(later.weight.sum())):
        raise ValueError(f"{name}.ratio: {traced:.3g} targets are traced back")
    return Transition(ratio, survival, int(orphans))


def _require_numbers(name: str, array: AnyArray, low: float, high: float) -> None:
    """Raise ValueError unless all entries are floats in [low, high], and finite."""
    if array.dtype.kind != "f":
        raise ValueError(f"{name}: {array.dtype} given, expected floats")
    if not (np.isfinite(array) & (array >= low) & (array <= high)).all():
        raise ValueError(f"{name}: a number is not finite, or outside [{low:g}, {high:g}]")


def _require_whole(name: str, array: AnyArray, low: int, high: int) -> None:
    """Raise ValueError unless all entries are whole numbers in [low, high]."""
    if array.dtype.kind != "i":
        raise ValueError(f"{name}: {array.dtype} given, expected whole numbers")
    if not ((array >= low) & (array <= high)).all():
        raise ValueError(f"{name}: a number is outside [{low}, {high}]")


def _put_sparse(snapshot: Snapshot, name: str, matrix: SparseArray) -> None:
    for part in ("data", "indices", "indptr"):
        snapshot.arrays[f"{name}.{part}"] = getattr(matrix, part)
    snapshot.arrays[f"{name}.shape"] = np.array(matrix.shape, dtype=np.int64)


def _take_sparse(snapshot: Snapshot, name: str, kind: Any) -> Any:
    parts = tuple(snapshot.array(f"{name}.{part}") for part in ("data", "indices", "indptr"))
    for part, array in zip(("indices", "indptr"), parts[1:], strict=True):
        _require_whole(f"{name}.{part}", array, 0, MOST_INDEX)
    shape = snapshot.array(f"{name}.shape")
    _require_whole(f"{name}.shape", shape, 0, MOST_INDEX)
    matrix = kind(parts, shape=tuple(shape.tolist()))
    matrix.check_format()
    return matrix
