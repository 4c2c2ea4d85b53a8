"""Storage of an engine's window in a snapshot, except for its sets and links, and its restoration.

`snapshot` says why every value is checked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import IntArray
from ..snapshot import (
    MOST_INDEX,
    MOST_STAMP_NS,
    Snapshot,
    require_covariances,
    require_numbers,
    require_whole,
    whole,
)
from ..targets.modes import ModeSpace
from ..types import COASTING, TENTATIVE, Estimates
from .entries import Current, Entry, LinkT, Rows, RowsT, Source

# Of any component of a state: metres, metres per second, radians per second.
MOST_STATE = 1e9
# Of one target and of what is traced back to it: a draw is right on the average only.
MASS_SLACK = 100.0
ESTIMATES = (
    "state",
    "covariance",
    "weight",
    "class_probability",
    "class_id",
    "track_id",
    "track_state",
)


def put_sources(snapshot: Snapshot, name: str, entry: Entry[RowsT, LinkT]) -> None:
    """Store the stamp of an entry, and where its rows come from."""
    snapshot.facts[name] = {
        "stamp_ns": entry.stamp_ns,
        "sources_ns": [source.stamp_ns for source in entry.sources],
        "sizes": [source.size for source in entry.sources],
    }
    for index, source in enumerate(entry.sources):
        if source.rows is not None:
            snapshot.arrays[f"{name}.source.{index}"] = source.rows


def take_sources(snapshot: Snapshot, name: str, most: int) -> tuple[int, tuple[Source, ...]]:
    """Return the stamp of a stored entry, and where its rows come from.

    Parameters
    ----------
    snapshot : Snapshot
    name : str
    most : int
        Rows that a source may have.

    Raises
    ------
    ValueError
        If they are none that the tracker could have stored.
    """
    facts = snapshot.facts[name]
    stamp_ns = whole(f"{name}.stamp_ns", facts["stamp_ns"], 0, MOST_STAMP_NS)
    sources = tuple(
        _take_source(snapshot, f"{name}.source.{index}", source_ns, size, stamp_ns, most)
        for index, (source_ns, size) in enumerate(
            zip(facts["sources_ns"], facts["sizes"], strict=True)
        )
    )
    return stamp_ns, sources


def require_rows_of(name: str, source: Source, stored: Rows) -> None:
    """Raise ValueError unless the rows of an entry's source are rows of this set."""
    size = len(stored)
    if source.rows is not None:
        require_whole(f"{name}.source", source.rows, 0, size - 1)
        size = len(source.rows)
    if size != source.size:
        raise ValueError(f"{name}.sizes: {source.size} rows, expected {size}")


def put_current(snapshot: Snapshot, current: Current[RowsT, LinkT]) -> None:
    """Store which rows of an entry no later scan has touched."""
    if current.rows is not None:
        snapshot.arrays[f"current.{current.entry.stamp_ns}"] = current.rows


def take_current(snapshot: Snapshot, entry: Entry[RowsT, LinkT]) -> Current[RowsT, LinkT]:
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
    require_whole(name, rows, 0, len(entry.stored) - 1)
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
    parts: dict[str, Any] = {part: snapshot.array(f"{name}.{part}") for part in ESTIMATES}
    count, size, classes = len(parts["track_id"]), len(modes.space), len(modes.classes)
    shapes = {
        "state": (count, size),
        "covariance": (count, size, size),
        "class_probability": (count, classes),
    }
    for part, array in parts.items():
        if array.shape != shapes.get(part, (count,)):
            raise ValueError(f"{name}.{part}: shape {array.shape}")
    require_numbers(f"{name}.state", parts["state"], -MOST_STATE, MOST_STATE)
    require_numbers(f"{name}.covariance", parts["covariance"], -(MOST_STATE**2), MOST_STATE**2)
    require_covariances(f"{name}.covariance", parts["covariance"])
    require_numbers(f"{name}.weight", parts["weight"], 0.0, MASS_SLACK)
    require_numbers(f"{name}.class_probability", parts["class_probability"], 0.0, MASS_SLACK)
    require_whole(f"{name}.class_id", parts["class_id"], 0, classes - 1)
    require_whole(f"{name}.track_id", parts["track_id"], 0, MOST_INDEX)
    require_whole(f"{name}.track_state", parts["track_state"], TENTATIVE, COASTING)
    return Estimates(stamp_ns=stamp_ns, lag=0, space=modes.space, **parts)


def _take_source(
    snapshot: Snapshot, name: str, stamp_ns: Any, size: Any, before: int, most: int
) -> Source:
    stamp_ns = whole(f"{name}.stamp_ns", stamp_ns, 0, before - 1)
    rows = _take_rows(snapshot, name) if name in snapshot.arrays else None
    size = whole(f"{name}.size", size, 0, most)
    if rows is not None and len(rows) != size:
        raise ValueError(f"{name}: {len(rows)} rows, expected {size}")
    return Source(stamp_ns, rows, size)


def _take_rows(snapshot: Snapshot, name: str) -> IntArray:
    rows = snapshot.array(name)
    require_whole(name, rows, 0, MOST_INDEX)
    if rows.ndim != 1 or (np.diff(rows) <= 0).any():
        raise ValueError(f"{name}: must be a list of ascending rows")
    ascending: IntArray = rows.astype(np.int64)
    return ascending
