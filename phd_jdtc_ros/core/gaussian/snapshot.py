"""Storage of mixtures and their links as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Mapping

from ..snapshot import MASS_SLACK, Snapshot, from_snapshot, to_snapshot
from ..window.entries import Entry
from ..window.window_snapshot import require_rows_of, sources_from_snapshot, sources_to_snapshot
from .algebra.kalman import Backward
from .dynamics import Dynamics
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry
from .window_graph import Link

GaussianEntry = Entry[Mixture, Link]


def entry_to_snapshot(entry: GaussianEntry, snapshot: Snapshot, name: str) -> None:
    """Store what the filter keeps of one scan."""
    sources_to_snapshot(entry, snapshot, name)
    to_snapshot(entry.stored, snapshot, name)
    if entry.link is not None:
        to_snapshot(entry.link.moves, snapshot, f"{name}.link")
        to_snapshot(entry.link.moves.backward, snapshot, f"{name}.link")
        to_snapshot(entry.link.ancestry, snapshot, f"{name}.link")


def entry_from_snapshot(
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
    modes, size = dynamics.supported.shape
    sizes = {"O": modes, "D": size, "S": len(dynamics.cells), "K": len(dynamics.pairs[0])}
    stamp_ns, sources = sources_from_snapshot(snapshot, name, most)
    if snapshot.array(f"{name}.origin").size > most:
        raise ValueError(f"{name}.origin: more than {most} hypotheses")
    stored = from_snapshot(Mixture, snapshot, name, sizes)
    if stored.existence.max(initial=0.0) > MASS_SLACK:
        raise ValueError(f"{name}.weight: a target of mass {stored.existence.max():.3g}")
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    for source in sources:
        if source.stamp_ns in earlier:
            require_rows_of(name, source, earlier[source.stamp_ns].stored)
    sizes |= {"H": len(stored), "P": sum(source.size for source in sources)}
    of_link = snapshot, f"{name}.link", sizes
    backward = from_snapshot(Backward, *of_link)
    moves = from_snapshot(Moves, *of_link, pairs=dynamics.pairs, backward=backward)
    return Entry(stamp_ns, stored, sources, Link(moves, from_snapshot(Ancestry, *of_link)))
