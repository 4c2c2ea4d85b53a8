# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Storage of the filter's entries as arrays of a snapshot, and their restoration.

A snapshot may come from a forged file: every value is checked against what the tracker itself could
have stored, so that none of them ends it or becomes an estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..arrays import FloatArray, IntArray, SparseArray
from ..models.modes import ModeSpace
from ..snapshot import MOST_STAMP_NS, Snapshot, whole
from ..types import Estimates
from .backward_kernel import Transition
from .entry import Current, Entry, Source
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
ESTIMATES = ("state", "covariance", "weight", "class_probability", "class_id", "track_id")
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


def put_entry(snapshot: Snapshot, name: str, entry: Entry) -> None:
    """Store what the filter keeps of one scan."""
    snapshot.facts[name] = {
        "stamp_ns": entry.stamp_ns,
        "sources_ns": [source.stamp_ns for source in entry.sources],
        "sizes": [source.size for source in entry.sources],
    }
    put_particles(snapshot, name, entry.stored)
    for index, source in enumerate(entry.sources):
        if source.rows is not None:
            snapshot.arrays[f"{name}.source.{index}"] = source.rows
    if entry.link is not None:
        _put_transition(snapshot, f"{name}.link", entry.link)


def take_entry(
    snapshot: Snapshot, name: str, earlier: Mapping[int, Entry], modes: ModeSpace, most: int
) -> Entry:
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
    facts = snapshot.facts[name]
    stamp_ns = whole(f"{name}.stamp_ns", facts["stamp_ns"], 0, MOST_STAMP_NS)
    stored = take_particles(snapshot, name, modes, most)
    sources = tuple(
        _take_source(snapshot, f"{name}.source.{index}", source_ns, size, stamp_ns, most)
        for index, (source_ns, size) in enumerate(
            zip(facts["sources_ns"], facts["sizes"], strict=True)
        )
    )
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    weights = [np.zeros(0), *(_weight_of(source, earlier, name) for source in sources)]
    link = _take_transition(snapshot, f"{name}.link", np.concatenate(weights), stored)
    return Entry(stamp_ns, stored, sources, link)


def _take_source(
    snapshot: Snapshot, name: str, stamp_ns: Any, size: Any, before: int, most: int
) -> Source:
    stamp_ns = whole(f"{name}.stamp_ns", stamp_ns, 0, before - 1)
    rows = _take_rows(snapshot, name) if name in snapshot.arrays else None
    size = whole(f"{name}.size", size, 0, SLACK * most)
    if rows is not None and len(rows) != size:
        raise ValueError(f"{name}: {len(rows)} rows, expected {size}")
    return Source(stamp_ns, rows, size)


def _weight_of(source: Source, earlier: Mapping[int, Entry], name: str) -> FloatArray:
    """Return the weights of a source's rows; zeros where its set has left the window."""
    if source.stamp_ns not in earlier:
        return np.zeros(source.size)
    weight = earlier[source.stamp_ns].stored.weight
    if source.rows is not None:
        _require_whole(f"{name}.source", source.rows, 0, len(weight) - 1)
        weight = weight[source.rows]
    if len(weight) != source.size:
        raise ValueError(f"{name}.sizes: {source.size} rows, expected {len(weight)}")
    return weight


def take_current(snapshot: Snapshot, entry: Entry) -> Current:
    """Return the rows of an entry that no later scan has touched.

    Raises
    ------
    ValueError
        If the stored rows are not rows of the entry.
    """
    name = f"current.{entry.stamp_ns}"
    if name not in snapshot.arrays:
        return Current(entry)
    rows = _take_rows(snapshot, name)
    _require_whole(name, rows, 0, len(entry.stored) - 1)
    return Current(entry, rows)


def put_estimates(snapshot: Snapshot, name: str, estimates: Estimates) -> None:
    """Store estimates, except for their stamp and lag."""
    for part in ESTIMATES:
        snapshot.arrays[f"{name}.{part}"] = getattr(estimates, part)


def take_estimates(snapshot: Snapshot, name: str, stamp_ns: int, modes: ModeSpace) -> Estimates:
    """Return stored filtered estimates of a stamp.

    Raises
    ------
    ValueError
        If they are none of these modes' tracker.
    """
    parts = {part: snapshot.array(f"{name}.{part}") for part in ESTIMATES}
    count, size, classes = len(parts["track_id"]), len(modes.space), len(modes.classes)
    shapes = {
        "state": (count, size),
        "covariance": (count, size, size),
        "class_probability": (count, classes),
    }
    for part, array in parts.items():
        if array.shape != shapes.get(part, (count,)):
            raise ValueError(f"{name}.{part}: shape {array.shape}")
    _require_numbers(f"{name}.state", parts["state"], -MOST_STATE, MOST_STATE)
    _require_numbers(f"{name}.covariance", parts["covariance"], -(MOST_STATE**2), MOST_STATE**2)
    _require_numbers(f"{name}.weight", parts["weight"], 0.0, MASS_SLACK)
    _require_numbers(f"{name}.class_probability", parts["class_probability"], 0.0, MASS_SLACK)
    _require_whole(f"{name}.class_id", parts["class_id"], 0, classes - 1)
    _require_whole(f"{name}.track_id", parts["track_id"], 0, MOST_INDEX)
    return Estimates(stamp_ns=stamp_ns, lag=0, space=modes.space, **parts)


def _take_rows(snapshot: Snapshot, name: str) -> IntArray:
    rows = snapshot.array(name)
    _require_whole(name, rows, 0, MOST_INDEX)
    if rows.ndim != 1 or (np.diff(rows) <= 0).any():
        raise ValueError(f"{name}: must be a list of ascending rows")
    ascending: IntArray = rows.astype(np.int64)
    return ascending


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
    _require_numbers(f"{name}.survival", survival, 0.0, 1.0)
    _require_numbers(f"{name}.ratio.data", ratio.data, 0.0, np.inf)
    orphans = snapshot.array(f"{name}.orphans")
    _require_whole(f"{name}.orphans", orphans, 0, len(later))
    # What later targets are traced back to is no more than there is of them.
    with np.errstate(over="ignore", invalid="ignore"):
        traced = float(earlier @ (ratio @ later.weight))
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
