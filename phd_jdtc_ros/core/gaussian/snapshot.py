"""Storage of mixtures and their links as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import FloatArray
from ..snapshot import MOST_INDEX, Snapshot, require_covariances, require_numbers, require_whole
from ..window.entries import Entry
from ..window.window_snapshot import (
    MASS_SLACK,
    MOST_STATE,
    put_sources,
    require_rows_of,
    take_sources,
)
from .dynamics import Dynamics
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry
from .window_graph import Link

GaussianEntry = Entry[Mixture, Link]
# Of a backward step: metres per radian per second are the largest of its units.
MOST_GAIN = 1e15
# Of covariances and their inverses.
MOST_FACTOR = 1e30


def put_entry(snapshot: Snapshot, name: str, entry: GaussianEntry) -> None:
    """Store what the filter keeps of one scan."""
    put_sources(snapshot, name, entry)
    stored, link = entry.stored, entry.link
    arrays = snapshot.arrays
    for part in ("origin", "weight", "mean", "covariance"):
        arrays[f"{name}.{part}"] = getattr(stored, part)
    if link is None:
        return
    moves, ancestry = link.moves, link.ancestry
    for part in ("change", "survival", "place", "mean", "factor", "gain", "base"):
        arrays[f"{name}.link.{part}"] = getattr(moves, part)
    if moves.cells is not None:
        arrays[f"{name}.link.cells"] = moves.cells
    for part in ("child", "parent", "share"):
        arrays[f"{name}.link.{part}"] = getattr(ancestry, part)


def take_entry(
    snapshot: Snapshot,
    name: str,
    earlier: Mapping[int, GaussianEntry],
    dynamics: Dynamics,
    most: int,
) -> GaussianEntry:
    """Return what the filter kept of one scan.

    Parameters
    ----------
    snapshot : Snapshot
    name : str
    earlier : mapping of stamp to Entry
        Those stored before it. A source that is none of them has left the window; its link goes
        with it.
    dynamics : Dynamics
        Of the tracker that goes on from it.
    most : int
        Hypotheses that it may have.

    Raises
    ------
    ValueError
        If it does not fit the tracker or the earlier entries.
    """
    stamp_ns, sources = take_sources(snapshot, name, most)
    stored = _take_mixture(snapshot, name, dynamics, most)
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    for source in sources:
        if source.stamp_ns in earlier:
            require_rows_of(name, source, earlier[source.stamp_ns].stored)
    predicted = sum(source.size for source in sources)
    link = Link(
        _take_moves(snapshot, f"{name}.link", dynamics, predicted),
        _take_ancestry(snapshot, f"{name}.link", dynamics, predicted, len(stored)),
    )
    return Entry(stamp_ns, stored, sources, link)


def _take_mixture(snapshot: Snapshot, name: str, dynamics: Dynamics, most: int) -> Mixture:
    origin = snapshot.array(f"{name}.origin")
    require_whole(f"{name}.origin", origin, 0, MOST_INDEX)
    count = len(origin)
    if origin.ndim != 1 or count > most:
        raise ValueError(f"{name}.origin: shape {origin.shape}, at most ({most},)")
    modes, size, cells = _sizes(dynamics)
    mixture = Mixture(
        origin,
        _numbers(snapshot, f"{name}.weight", (count, modes, cells), 0.0, MASS_SLACK),
        _numbers(snapshot, f"{name}.mean", (count, modes, size), -MOST_STATE, MOST_STATE),
        _covariances(snapshot, f"{name}.covariance", (count, modes, size, size)),
    )
    if mixture.existence.max(initial=0.0) > MASS_SLACK:
        raise ValueError(f"{name}.weight: a target of mass {mixture.existence.max():.3g}")
    return mixture


def _take_moves(snapshot: Snapshot, name: str, dynamics: Dynamics, count: int) -> Moves:
    modes, size, cells = _sizes(dynamics)
    place = snapshot.array(f"{name}.place")
    shape = count, len(dynamics.pairs[0])
    if place.shape != shape:
        raise ValueError(f"{name}.place: shape {place.shape}, expected {shape}")
    of_pair = (int(np.count_nonzero(place >= 0)), size, size)
    require_whole(f"{name}.place", place, -1, of_pair[0] - 1)
    of_cells = None
    if f"{name}.cells" in snapshot.arrays:
        of_cells = _numbers(snapshot, f"{name}.cells", (count, cells, cells), 0.0, 1.0)
    return Moves(
        dynamics.pairs,
        _numbers(snapshot, f"{name}.change", shape, 0.0, 1.0),
        _numbers(snapshot, f"{name}.survival", (count, modes), 0.0, 1.0),
        of_cells,
        place,
        _numbers(snapshot, f"{name}.mean", of_pair[:2], -MOST_STATE, MOST_STATE),
        _numbers(snapshot, f"{name}.factor", of_pair, -MOST_FACTOR, MOST_FACTOR),
        _numbers(snapshot, f"{name}.gain", of_pair, -MOST_GAIN, MOST_GAIN),
        # A small difference of large covariances, which rounding may leave without a square root.
        _numbers(snapshot, f"{name}.base", of_pair, -(MOST_STATE**2), MOST_STATE**2),
    )


def _take_ancestry(
    snapshot: Snapshot, name: str, dynamics: Dynamics, parents: int, children: int
) -> Ancestry:
    modes, _, cells = _sizes(dynamics)
    child, parent = snapshot.array(f"{name}.child"), snapshot.array(f"{name}.parent")
    require_whole(f"{name}.child", child, 0, children - 1)
    require_whole(f"{name}.parent", parent, -1, parents - 1)
    if child.ndim != 1 or child.shape != parent.shape:
        raise ValueError(f"{name}: {child.shape} children, {parent.shape} parents")
    share = _numbers(snapshot, f"{name}.share", (len(child), modes, cells), 0.0, 1.0)
    return Ancestry(child, parent, share)


def _sizes(dynamics: Dynamics) -> tuple[int, int, int]:
    """Return the numbers of motion modes, axes of a state, and cells."""
    modes, size = dynamics.supported.shape
    return modes, size, len(dynamics.cells)


def _numbers(
    snapshot: Snapshot, name: str, shape: tuple[int, ...], low: float, high: float
) -> FloatArray:
    """Return a stored array of this shape with all numbers in [low, high]."""
    array: FloatArray = snapshot.array(name)
    if array.shape != shape:
        raise ValueError(f"{name}: shape {array.shape}, expected {shape}")
    require_numbers(name, array, low, high)
    return array


def _covariances(snapshot: Snapshot, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Return stored covariances; raises ValueError if one is none."""
    array = _numbers(snapshot, name, shape, -(MOST_STATE**2), MOST_STATE**2)
    require_covariances(name, array)
    return array
