"""Rows of a window that represent the targets at a stamp, and entries that are still needed."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..arrays import IntArray
from .entries import Entry, LinkT, RowsT, UnsweptRows


def rows_at(
    window: Sequence[Entry[RowsT, LinkT]],
    unswept: Sequence[UnsweptRows[RowsT, LinkT]],
    stamp_ns: int,
) -> dict[int, IntArray | None]:
    """Return the rows that represent the targets at a stamp, by the stamp of their entry.

    None stands for all rows of an entry. These are the rows of entries up to the stamp that only
    later entries, or no entry yet, continue.
    """
    sources = [rows.source for rows in unswept]
    for entry in window:
        if entry.stamp_ns > stamp_ns:
            sources += entry.sources
    parts_of: dict[int, list[IntArray | None]] = {}
    earlier = {entry.stamp_ns for entry in window if entry.stamp_ns <= stamp_ns}
    for source in sources:
        if source.stamp_ns in earlier:
            parts_of.setdefault(source.stamp_ns, []).append(source.rows)
    return {stamp: _join_rows(row_parts) for stamp, row_parts in parts_of.items()}


def _join_rows(parts: Sequence[IntArray | None]) -> IntArray | None:
    """Return several parts of the rows of an entry as one."""
    listed = [rows for rows in parts if rows is not None]
    if len(listed) < len(parts):
        return None
    return listed[0] if len(listed) == 1 else np.concatenate(listed)


def interpolation_stamps(
    window: Sequence[Entry[RowsT, LinkT]], stamp_ns: int, alive: Collection[int]
) -> list[int]:
    """Return the stamps of the entries to interpolate between, ascending.

    `alive` has the stamps of `rows_at`.
    """
    return [
        entry.stamp_ns
        for entry in window
        if entry.stamp_ns in alive
        or (entry.stamp_ns > stamp_ns and not entry.source_stamps.isdisjoint(alive))
    ]


def trim(
    window: list[Entry[RowsT, LinkT]],
    unswept: Sequence[UnsweptRows[RowsT, LinkT]],
    following: int,
) -> list[Entry[RowsT, LinkT]]:
    """Return the entries that the filter or a pending stamp, from `following` on, needs."""
    dropped = {entry.stamp_ns for entry in window if entry.stamp_ns < following}
    dropped.difference_update(
        [rows.entry.stamp_ns for rows in unswept],
        *[entry.source_stamps for entry in window if entry.stamp_ns > following],
    )
    if not dropped:
        return window
    remaining = [entry for entry in window if entry.stamp_ns not in dropped]
    stamps = {entry.stamp_ns for entry in remaining}
    return [entry if entry.source_stamps & stamps else entry.unlinked for entry in remaining]
