"""Storage of the window: its stamps, its entries, and the rows not yet swept again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..gaussian.dynamics import Dynamics
from ..gaussian.entries import Entry, Link, Source, UnsweptRows
from ..gaussian.mixture import Mixture
from ..gaussian.prediction import Moves
from ..gaussian.reduction import Ancestry
from ..snapshot import MAX_MASS, MAX_STAMP_NS, Snapshot, from_snapshot, integers, to_snapshot
from ..tracks.track_numbers import MAX_SCANS


class Window(NamedTuple):
    """The window's part of a snapshot."""

    # Stamps whose smoothed estimates are pending, (Q,).
    stamps_ns: Annotated[IntArray, integers("Q", 0, MAX_STAMP_NS, ascending=True)]
    entries: Annotated[int, integers("", 0, MAX_SCANS)]  # Number of sets


class Sources(NamedTuple):
    """The stamp and sources of an entry as arrays."""

    stamp_ns: Annotated[int, integers("", 0, MAX_STAMP_NS)]
    source_ns: Annotated[IntArray, integers("Q", 0, MAX_STAMP_NS)]  # Stamp of each source, (Q,)
    size: Annotated[IntArray, integers("Q", 0)]  # Number of rows of each source, (Q,)
    # 1 if the rows of a source are listed in `rows`, 0 if it has all rows of its set, (Q,).
    listed: Annotated[IntArray, integers("Q", 0, 1)]
    rows: Annotated[IntArray, integers("R", 0)]  # Concatenated rows of all listed sources, (R,)


class UnsweptIndices(NamedTuple):
    """The rows of an entry that no later scan has swept; None for all rows."""

    rows: Annotated[IntArray | None, integers("R", 0, ascending=True)]


def _sources_to_snapshot(entry: Entry, snapshot: Snapshot, name: str) -> None:
    rows = [source.rows for source in entry.sources if source.rows is not None]
    table = Sources(
        entry.stamp_ns,
        np.array([source.stamp_ns for source in entry.sources], dtype=np.int64),
        np.array([source.size for source in entry.sources], dtype=np.int64),
        np.array([source.rows is not None for source in entry.sources], dtype=np.int64),
        np.concatenate([np.zeros(0, dtype=np.int64), *rows]),
    )
    to_snapshot(table, snapshot, name)


def _sources_from_snapshot(
    snapshot: Snapshot, name: str, most: int
) -> tuple[int, tuple[Source, ...]]:
    """Return the stamp and the sources of a stored entry, of at most `most` rows each."""
    table = from_snapshot(Sources, snapshot, name, {})
    if table.source_ns.max(initial=-1) >= table.stamp_ns:
        raise ValueError(f"{name}.source_ns: not before {table.stamp_ns}")
    if table.size.max(initial=0) > most:
        raise ValueError(f"{name}.size: {table.size.max()} rows, at most {most}")
    end = np.cumsum(table.size * table.listed)
    if len(table.rows) != end[-1:].sum():
        raise ValueError(f"{name}.rows: {len(table.rows)} rows, expected {end[-1:].sum()}")
    sources = []
    columns = zip(*(column.tolist() for column in (*table[1:4], end)), strict=True)
    for stamp_ns, size, listed, last in columns:
        rows = table.rows[last - size : last] if listed else None
        if rows is not None and (np.diff(rows) <= 0).any():
            raise ValueError(f"{name}.rows: must increase")
        sources.append(Source(stamp_ns, rows, size))
    return table.stamp_ns, tuple(sources)


def _require_rows_of(name: str, source: Source, stored: Mixture) -> None:
    size = len(stored)
    if source.rows is not None:
        if source.rows.max(initial=-1) >= size:
            raise ValueError(f"{name}.rows: {source.rows.max()} given, must be below {size}")
        size = len(source.rows)
    if size != source.size:
        raise ValueError(f"{name}.size: {source.size} rows, expected {size}")


def _entry_to_snapshot(entry: Entry, snapshot: Snapshot, name: str) -> None:
    _sources_to_snapshot(entry, snapshot, name)
    to_snapshot(entry.stored, snapshot, name)
    if entry.link is not None:
        to_snapshot(entry.link.moves, snapshot, f"{name}.link")
        to_snapshot(entry.link.ancestry, snapshot, f"{name}.link")


def _entry_from_snapshot(
    snapshot: Snapshot, name: str, earlier: Mapping[int, Entry], dynamics: Dynamics, most: int
) -> Entry:
    """Return the stored entry of one scan, of at most `most` hypotheses.

    `earlier` has the entries stored before it, by stamp. If a source is not among them it has left
    the window, and the link is dropped.
    """
    modes, size = dynamics.supported.shape
    classes, cells = dynamics.cells.log_snr.shape
    sizes = {"O": modes, "C": classes, "S": cells, "D": size, "K": len(dynamics.pairs[0])}
    stamp_ns, sources = _sources_from_snapshot(snapshot, name, most)
    if snapshot.array(f"{name}.origin").size > most:
        raise ValueError(f"{name}.origin: more than {most} hypotheses")
    stored = from_snapshot(Mixture, snapshot, name, sizes)
    if stored.sums.existence.max(initial=0.0) > MAX_MASS:
        raise ValueError(f"{name}.weight: a target of mass {stored.sums.existence.max():.3g}")
    if f"{name}.link.survival" not in snapshot.arrays:
        return Entry(stamp_ns, stored, sources)
    for source in sources:
        if source.stamp_ns in earlier:
            _require_rows_of(name, source, earlier[source.stamp_ns].stored)
    sizes |= {"H": len(stored), "P": sum(source.size for source in sources)}
    of_link = snapshot, f"{name}.link", sizes
    moves = from_snapshot(Moves, *of_link, pairs=dynamics.pairs)
    return Entry(stamp_ns, stored, sources, Link(moves, from_snapshot(Ancestry, *of_link)))


def unswept_to_snapshot(unswept: UnsweptRows, snapshot: Snapshot) -> None:
    """Store the rows of an entry that no later scan has swept."""
    to_snapshot(UnsweptIndices(unswept.rows), snapshot, f"current.{unswept.entry.stamp_ns}")


def unswept_from_snapshot(snapshot: Snapshot, entry: Entry) -> UnsweptRows:
    """Return the stored rows of an entry; raise `ValueError` if they are not rows of it."""
    name = f"current.{entry.stamp_ns}"
    rows = from_snapshot(UnsweptIndices, snapshot, name, {}).rows
    if rows is not None and rows.max(initial=-1) >= len(entry.stored):
        raise ValueError(f"{name}.rows: {rows.max()} given, must be below {len(entry.stored)}")
    return UnsweptRows(entry, rows)


def window_to_snapshot(
    stamps_ns: Sequence[int], window: Sequence[Entry], snapshot: Snapshot
) -> None:
    """Store the pending stamps and the entries."""
    table = Window(np.array(stamps_ns, dtype=np.int64), len(window))
    to_snapshot(table, snapshot, "window")
    for index, entry in enumerate(window):
        _entry_to_snapshot(entry, snapshot, f"stored.{index}")


def window_from_snapshot(
    snapshot: Snapshot, dynamics: Dynamics, most: int
) -> tuple[list[int], dict[int, Entry]]:
    """Return the pending stamps, and the entries by stamp, of at most `most` hypotheses each.

    Raise `ValueError` if the tracker with these dynamics could not have stored them.
    """
    table, latest = from_snapshot(Window, snapshot, "window", {}), snapshot.stamp_ns
    if latest is not None and not (type(latest) is int and 0 <= latest <= MAX_STAMP_NS):
        raise ValueError(f"stamp_ns: {str(latest)[:40]} given, must be a stamp, nanoseconds")
    stamps = table.stamps_ns.tolist()
    if stamps and (latest is None or stamps[-1] > latest):
        raise ValueError(
            f"window.stamps_ns: the last stamp is {stamps[-1]}, must be at most {latest}"
        )
    entries: dict[int, Entry] = {}
    for index in range(table.entries):
        entry = _entry_from_snapshot(snapshot, f"stored.{index}", entries, dynamics, most)
        if entries and entry.stamp_ns <= max(entries):
            raise ValueError(f"stored.{index}.stamp_ns: must increase")
        entries[entry.stamp_ns] = entry
    return stamps, entries
