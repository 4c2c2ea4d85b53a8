"""Storage of particle sets and their transitions as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, SparseArray
from ..snapshot import MOST_INDEX, Snapshot, require_numbers, require_whole
from ..targets.modes import ModeSpace
from ..window.entries import Entry, Source
from ..window.window_snapshot import (
    MASS_SLACK,
    MOST_STATE,
    put_sources,
    require_rows_of,
    take_sources,
)
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import ParticleSet

MOST_LOG_SNR = 100.0
# How much more than the budget a set may have: groups that survive by lot come on top.
SLACK = 4
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
    require_numbers(f"{name}.state", parts["state"], -MOST_STATE, MOST_STATE)
    require_numbers(f"{name}.log_snr", parts["log_snr"], -MOST_LOG_SNR, MOST_LOG_SNR)
    require_whole(f"{name}.mode", parts["mode"], 0, len(modes) - 1)
    require_whole(f"{name}.origin", parts["origin"], 0, MOST_INDEX)
    require_whole(f"{name}.parent", parts["parent"], -1, MOST_INDEX)
    require_whole(f"{name}.multiplicity", parts["multiplicity"], 1, SLACK * most)
    require_whole(f"{name}.label", parts["label"], -1, MOST_INDEX)
    # There is at least about one particle a target.
    require_numbers(f"{name}.poisson", parts["poisson"], 0.0, SLACK * most)
    require_numbers(f"{name}.components.data", components.data, 0.0, SLACK * most)
    mass = float(parts["poisson"].sum() + components.data.sum())
    copies = int(parts["multiplicity"].astype(np.float64).sum())
    if copies > SLACK * most or mass > SLACK * most:
        raise ValueError(f"{name}: {copies} particles of mass {mass:.3g}, at most {SLACK * most}")
    return ParticleSet(components=components, **parts)


def put_entry(snapshot: Snapshot, name: str, entry: ParticleEntry) -> None:
    """Store what the filter keeps of one scan."""
    put_sources(snapshot, name, entry)
    put_particles(snapshot, name, entry.stored)
    if entry.link is not None:
        _put_transition(snapshot, f"{name}.link", entry.link)


def take_entry(
    snapshot: Snapshot, name: str, earlier: Mapping[int, ParticleEntry], modes: ModeSpace, most: int
) -> ParticleEntry:
    """Return what the filter kept of one scan.

    Parameters
    ----------
    snapshot : Snapshot
    name : str
    earlier : mapping of stamp to Entry
        Those stored before it. A source that is none of them has left the window; its link goes
        with it.
    modes : ModeSpace
    most : int
        Particles that it may have.

    Raises
    ------
    ValueError
        If it does not fit the tracker or the earlier entries.
    """
    stamp_ns, sources = take_sources(snapshot, name, SLACK * most)
    stored = take_particles(snapshot, name, modes, most)
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    weights = [np.zeros(0), *(_weight_of(source, earlier, name) for source in sources)]
    link = _take_transition(snapshot, f"{name}.link", np.concatenate(weights), stored)
    return Entry(stamp_ns, stored, sources, link)


def _weight_of(source: Source, earlier: Mapping[int, ParticleEntry], name: str) -> FloatArray:
    """Return the weights of a source's rows; zeros where its set has left the window."""
    if source.stamp_ns not in earlier:
        return np.zeros(source.size)
    stored = earlier[source.stamp_ns].stored
    require_rows_of(name, source, stored)
    return stored.weight if source.rows is None else stored.weight[source.rows]


def _put_transition(snapshot: Snapshot, name: str, link: Transition) -> None:
    snapshot.arrays[f"{name}.survival"] = link.survival
    snapshot.arrays[f"{name}.orphans"] = np.array(link.orphans)
    _put_sparse(snapshot, f"{name}.ratio", link.ratio)


def _take_transition(
    snapshot: Snapshot, name: str, earlier: FloatArray, later: ParticleSet
) -> Transition:
    """Return a stored transition from rows of these weights; raises ValueError if it is none."""
    ratio = _take_sparse(snapshot, f"{name}.ratio", sparse.csc_array)
    survival = snapshot.array(f"{name}.survival")
    if ratio.shape != (len(earlier), len(later)) or len(survival) != len(earlier):
        raise ValueError(
            f"{name}: {ratio.shape} and {len(survival)} rows, expected "
            f"({len(earlier)}, {len(later)}) and {len(earlier)}"
        )
    require_numbers(f"{name}.survival", survival, 0.0, 1.0)
    require_numbers(f"{name}.ratio.data", ratio.data, 0.0, np.inf)
    orphans = snapshot.array(f"{name}.orphans")
    require_whole(f"{name}.orphans", orphans, 0, len(later))
    # What later targets are traced back to is no more than there is of them.
    with np.errstate(over="ignore", invalid="ignore"):
        traced = float(earlier @ (ratio @ later.weight))
    if not traced <= MASS_SLACK * (1.0 + float(later.weight.sum())):
        raise ValueError(f"{name}.ratio: {traced:.3g} targets are traced back")
    return Transition(ratio, survival, int(orphans))


def _put_sparse(snapshot: Snapshot, name: str, matrix: SparseArray) -> None:
    for part in ("data", "indices", "indptr"):
        snapshot.arrays[f"{name}.{part}"] = getattr(matrix, part)
    snapshot.arrays[f"{name}.shape"] = np.array(matrix.shape, dtype=np.int64)


def _take_sparse(snapshot: Snapshot, name: str, kind: Any) -> Any:
    parts = tuple(snapshot.array(f"{name}.{part}") for part in ("data", "indices", "indptr"))
    for part, array in zip(("indices", "indptr"), parts[1:], strict=True):
        require_whole(f"{name}.{part}", array, 0, MOST_INDEX)
    shape = snapshot.array(f"{name}.shape")
    require_whole(f"{name}.shape", shape, 0, MOST_INDEX)
    matrix = kind(parts, shape=tuple(shape.tolist()))
    matrix.check_format()
    return matrix
