"""Storage of particle sets and their transitions as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import FloatArray
from ..snapshot import MAX_MASS, Snapshot, from_snapshot, to_snapshot
from ..targets.modes import ModeSpace
from ..window.entries import Entry, Source
from ..window.window_snapshot import require_rows_of, sources_from_snapshot, sources_to_snapshot
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import ParticleSet

# Largest ratio of a set's particles to its budget, which excludes groups kept by a random draw.
SLACK = 4


def entry_to_snapshot(entry: ParticleEntry, snapshot: Snapshot, name: str) -> None:
    """Store the filter's entry of one scan."""
    sources_to_snapshot(entry, snapshot, name)
    to_snapshot(entry.stored, snapshot, name)
    if entry.link is not None:
        to_snapshot(entry.link, snapshot, f"{name}.link")


def entry_from_snapshot(
    snapshot: Snapshot, name: str, earlier: Mapping[int, ParticleEntry], modes: ModeSpace, most: int
) -> ParticleEntry:
    """Return the stored entry of one scan.

    If a source is not among the entries stored before it, it has left the window, and the link is
    dropped. `most` is the largest number of particles allowed. Raise `ValueError` if the entry does
    not fit the tracker or the earlier entries.
    """
    stamp_ns, sources = sources_from_snapshot(snapshot, name, SLACK * most)
    stored = from_snapshot(ParticleSet, snapshot, name, {"D": len(modes.space), "O": len(modes)})
    # A target has about one particle or more, which bounds the mass.
    mass, copies = float(stored.weight.sum()), float(stored.multiplicity.sum(dtype=np.float64))
    if not max(mass, copies) <= SLACK * most:
        raise ValueError(f"{name}: {copies:g} particles of mass {mass:.3g}, at most {SLACK * most}")
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    weights = [np.zeros(0), *(_weight_of(source, earlier, name) for source in sources)]
    link = _transition(snapshot, f"{name}.link", np.concatenate(weights), stored)
    return Entry(stamp_ns, stored, sources, link)


def _weight_of(source: Source, earlier: Mapping[int, ParticleEntry], name: str) -> FloatArray:
    """Return the weights of a source's rows; zeros if its set has left the window."""
    if source.stamp_ns not in earlier:
        return np.zeros(source.size)
    stored = earlier[source.stamp_ns].stored
    require_rows_of(name, source, stored)
    return stored.weight if source.rows is None else stored.weight[source.rows]


def _transition(
    snapshot: Snapshot, name: str, earlier: FloatArray, later: ParticleSet
) -> Transition:
    """Return a stored transition from rows of these weights; raises ValueError if invalid."""
    link = from_snapshot(Transition, snapshot, name, {"E": len(earlier), "N": len(later)})
    if link.orphans > len(later):
        raise ValueError(f"{name}.orphans: {link.orphans} given, at most {len(later)}")
    # The mass traced back from later targets cannot exceed their number.
    with np.errstate(over="ignore", invalid="ignore"):
        traced = float(earlier @ (link.ratio @ later.weight))
    if not traced <= MAX_MASS * (1.0 + float(later.weight.sum())):
        raise ValueError(f"{name}.ratio: {traced:.3g} targets are traced back")
    return link
