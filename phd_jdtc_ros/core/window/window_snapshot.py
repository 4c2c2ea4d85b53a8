"""Storage of the sources of the window's entries, and of the rows that later scans continue."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..snapshot import MOST_STAMP_NS, Snapshot, from_snapshot, integers, to_snapshot
from .entries import Current, Entry, LinkT, Rows, RowsT, Source


class Sources(NamedTuple):
    """The stamp and sources of an entry as arrays.

    Parameters
    ----------
    source_ns : int array of shape (Q,)
        Stamp of each source.
    size : int array of shape (Q,)
        Number of rows of each source.
    listed : int array of shape (Q,)
        1 if the rows of a source are listed in `rows`, 0 if it has all rows of its set.
    rows : int array of shape (R,)
        Concatenated rows of all listed sources.
    """

    stamp_ns: Annotated[int, integers("", 0, MOST_STAMP_NS)]
    source_ns: Annotated[IntArray, integers("Q", 0, MOST_STAMP_NS)]
    size: Annotated[IntArray, integers("Q", 0)]
    listed: Annotated[IntArray, integers("Q", 0, 1)]
    rows: Annotated[IntArray, integers("R", 0)]


class Untouched(NamedTuple):
    """The rows of an entry that no later scan has swept; None for all rows."""

    rows: Annotated[IntArray | None, integers("R", 0, ascending=True)]


def sources_to_snapshot(entry: Entry[RowsT, LinkT], snapshot: Snapshot, name: str) -> None:
    """Store the stamp and the sources of an entry."""
    rows = [source.rows for source in entry.sources if source.rows is not None]
    table = Sources(
        entry.stamp_ns,
        np.array([source.stamp_ns for source in entry.sources], dtype=np.int64),
        np.array([source.size for source in entry.sources], dtype=np.int64),
        np.array([source.rows is not None for source in entry.sources], dtype=np.int64),
        np.concatenate([np.zeros(0, dtype=np.int64), *rows]),
    )
    to_snapshot(table, snapshot, name)


def sources_from_snapshot(
    snapshot: Snapshot, name: str, most: int
) -> tuple[int, tuple[Source, ...]]:
    """Return the stamp and the sources of a stored entry.

    Parameters
    ----------
    most : int
        Largest number of rows of a source.

    Raises
    ------
    ValueError
        If the tracker could not have stored them.
    """
    table = from_snapshot(Sources, snapshot, name, {})
    if table.source_ns.max(initial=-1) >= table.stamp_ns:
        raise ValueError(f"{name}.source_ns: not before {table.stamp_ns}")
    if table.size.max(initial=0) > most:
        raise ValueError(f"{name}.size: {table.size.max()} rows, at most {most}")
    end = np.cumsum(table.size * table.listed)
    if len(table.rows) != end[-1:].sum():
        raise ValueError(f"{name}.rows: {len(table.rows)} rows, expected {end[-1:].sum()}")
    sources = []
    columns = zip(*(part.tolist() for part in (*table[1:4], end)), strict=True)
    for stamp_ns, size, listed, last in columns:
        rows = table.rows[last - size : last] if listed else None
        if rows is not None and (np.diff(rows) <= 0).any():
            raise ValueError(f"{name}.rows: must increase")
        sources.append(Source(stamp_ns, rows, size))
    return table.stamp_ns, tuple(sources)


def require_rows_of(name: str, source: Source, stored: Rows) -> None:
    """Raise ValueError unless the rows of an entry's source are rows of this set."""
    size = len(stored)
    if source.rows is not None:
        if source.rows.max(initial=-1) >= size:
            raise ValueError(f"{name}.rows: {source.rows.max()} given, must be below {size}")
        size = len(source.rows)
    if size != source.size:
        raise ValueError(f"{name}.size: {source.size} rows, expected {size}")


def current_to_snapshot(current: Current[RowsT, LinkT], snapshot: Snapshot) -> None:
    """Store the rows of an entry that no later scan has swept."""
    to_snapshot(Untouched(current.rows), snapshot, f"current.{current.entry.stamp_ns}")


def current_from_snapshot(snapshot: Snapshot, entry: Entry[RowsT, LinkT]) -> Current[RowsT, LinkT]:
    """Return the rows of an entry that no later scan has swept.

    Raises
    ------
    ValueError
        If the stored rows are not rows of the entry.
    """
    name = f"current.{entry.stamp_ns}"
    rows = from_snapshot(Untouched, snapshot, name, {}).rows
    if rows is not None and rows.max(initial=-1) >= len(entry.stored):
        raise ValueError(f"{name}.rows: {rows.max()} given, must be below {len(entry.stored)}")
    return Current(entry, rows)
