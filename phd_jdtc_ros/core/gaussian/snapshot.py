"""Storage of mixtures and their links as arrays of a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Mapping

from ..snapshot import MAX_MASS, Snapshot, from_snapshot, to_snapshot
from ..window.entries import Entry
from ..window.window_snapshot import require_rows_of, sources_from_snapshot, sources_to_snapshot
from .dynamics import Dynamics
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry
from .smoothing.lineages import Link

GaussianEntry = Entry[Mixture, Link]


def entry_to_snapshot(entry: GaussianEntry, snapshot: Snapshot, name: str) -> None:
    """Store the filter's entry of one scan."""
    sources_to_snapshot(entry, snapshot, name)
    to_snapshot(entry.stored, snapshot, name)
    if entry.link is not None:
        to_snapshot(entry.link.moves, snapshot, f"{name}.link")
        to_snapshot(entry.link.ancestry, snapshot, f"{name}.link")


def entry_from_snapshot(
    snapshot: Snapshot,
    name: str,
    earlier: Mapping[int, GaussianEntry],
    dynamics: Dynamics,
    most: int,
) -> GaussianEntry:
    """Return the stored entry of one scan.

    Parameters
    ----------
    earlier : mapping of stamp to Entry
        Entries stored before it. If a source is not among them it has left the window, and the
        link is dropped.
    dynamics : Dynamics
        Dynamics of the tracker that continues from the entry.
    most : int
        Largest number of hypotheses allowed.

    Raises
    ------
    ValueError
        If the entry does not fit the tracker or the earlier entries.
    """
    modes, size = dynamics.supported.shape
    classes, cells = dynamics.cells.log_snr.shape
    sizes = {"O": modes, "C": classes, "S": cells, "D": size, "K": len(dynamics.pairs[0])}
    stamp_ns, sources = sources_from_snapshot(snapshot, name, most)
    if snapshot.array(f"{name}.origin").size > most:
        raise ValueError(f"{name}.origin: more than {most} hypotheses")
    stored = from_snapshot(Mixture, snapshot, name, sizes)
    if stored.existence.max(initial=0.0) > MAX_MASS:
        raise ValueError(f"{name}.weight: a target of mass {stored.existence.max():.3g}")
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    for source in sources:
        if source.stamp_ns in earlier:
            require_rows_of(name, source, earlier[source.stamp_ns].stored)
    sizes |= {"H": len(stored), "P": sum(source.size for source in sources)}
    of_link = snapshot, f"{name}.link", sizes
    moves = from_snapshot(Moves, *of_link, pairs=dynamics.pairs)
    return Entry(stamp_ns, stored, sources, Link(moves, from_snapshot(Ancestry, *of_link)))
