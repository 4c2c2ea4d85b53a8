"""Groups the targets of a window by the number of later scans that continue them.

A turning radar makes many small scans, each with the few targets that the antenna passed, so that
neighbouring targets were last updated in different scans. The backward pass treats targets
independently: one step takes every target back to its previous update, whichever scan that was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..arrays import IntArray
from ..window.entries import Entry
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses.

    Parameters
    ----------
    moves : Moves
        From the earlier hypotheses, concatenated over all sources of the scan, to the predicted
        ones.
    ancestry : Ancestry
        From the predicted hypotheses to the kept ones.
    """

    moves: Moves
    ancestry: Ancestry


@dataclass(frozen=True)
class Generation:
    """Targets that are continued by the same number of later scans of a window.

    Parameters
    ----------
    rows : int array
        Their indices in the hypotheses of all scans of the window, concatenated.
    link : Link or None
        Link back to all hypotheses of the next generation; None for the last one.
    """

    stored: Mixture
    rows: IntArray
    link: Link | None


def generations(entries: Sequence[Entry[Mixture, Link]]) -> list[Generation]:
    """Return the generations of a window, beginning with targets that no later scan continues.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source outside these entries has left the window.
    """
    every = Mixture.concatenate([entry.stored for entry in entries])
    ends = np.cumsum([0, *(len(entry.stored) for entry in entries)])
    depth, predicted = _depths(entries, every, ends)
    links = [entry.link for entry in reversed(entries) if entry.link is not None]
    if not links:
        return [Generation(every, np.arange(len(every)), None)]
    moves = Moves.concatenate([link.moves for link in links])
    edges = _edges(entries, ends)
    # A predicted hypothesis whose source has left the window sends no message.
    of_edge = predicted.depth[edges.parent]
    found, rows = [], np.flatnonzero(depth == 0)
    place, rank = np.empty(len(every), dtype=np.int64), np.empty(len(moves.change), dtype=np.int64)
    for level in range(int(predicted.depth.max(initial=-1)) + 1):
        to = np.flatnonzero(predicted.depth == level)
        place[rows], rank[to] = np.arange(len(rows)), np.arange(len(to))
        own = np.flatnonzero(of_edge == level)
        ancestry = Ancestry(place[edges.child[own]], rank[edges.parent[own]], edges.share[own])
        found.append(Generation(every.take(rows), rows, Link(moves.take(to), ancestry)))
        rows = predicted.source[to]
    return [*found, Generation(every.take(rows), rows, None)]


def is_chain(entries: Sequence[Entry[Mixture, Link]]) -> bool:
    """Return whether every scan continues exactly the targets of the previous one."""
    return all(
        len(entry.sources) == 1
        and entry.sources[0].rows is None
        and entry.sources[0].stamp_ns == before.stamp_ns
        for before, entry in pairwise(entries)
    )


@dataclass(frozen=True)
class _Predicted:
    """The predicted hypotheses of all scans, newest scan first.

    Parameters
    ----------
    source : int array of shape (P,)
        Index of each one's source in the hypotheses of all scans; -1 if it has left the window.
    depth : int array of shape (P,)
        Number of scans that continue its target after the predicted scan; -1 without a source.
    """

    source: IntArray
    depth: IntArray


def _depths(
    entries: Sequence[Entry[Mixture, Link]], every: Mixture, ends: IntArray
) -> tuple[IntArray, _Predicted]:
    """Return the number of later scans that continue each hypothesis, and the predicted ones."""
    first = {entry.stamp_ns: int(end) for entry, end in zip(entries, ends, strict=False)}
    depth = np.zeros(len(every), dtype=np.int64)
    sources, depths = [], []
    for entry in reversed(entries):
        if entry.link is None:
            continue
        source = np.concatenate(
            [
                np.full(part.size, -1)
                if part.stamp_ns not in first
                else first[part.stamp_ns]
                + (np.arange(part.size) if part.rows is None else part.rows)
                for part in entry.sources
            ]
        )
        stored, begin = entry.stored, first[entry.stamp_ns]
        later = np.zeros(len(stored.label) + 1, dtype=np.int64)
        later[stored.target] = depth[begin : begin + len(stored)]
        # No later scan continues a target that this scan has dropped.
        target = np.searchsorted(stored.label, every.row_label[source])
        gone = np.append(stored.label, -1)[target] != every.row_label[source]
        here = np.where(gone, 0, later[target])
        depth[source[source >= 0]] = here[source >= 0] + 1
        sources.append(source)
        depths.append(np.where(source >= 0, here, -1))
    none = [np.zeros(0, dtype=np.int64)]
    return depth, _Predicted(np.concatenate(none + sources), np.concatenate(none + depths))


def _edges(entries: Sequence[Entry[Mixture, Link]], ends: IntArray) -> Ancestry:
    """Return all ancestries of a window as one, without born targets: these have no parent."""
    child, parent, share, predicted = [], [], [], 0
    for entry, begin in zip(reversed(entries), ends[-2::-1], strict=True):
        if entry.link is None:
            continue
        ancestry = entry.link.ancestry
        known = np.flatnonzero(ancestry.parent >= 0)
        child.append(ancestry.child[known] + begin)
        parent.append(ancestry.parent[known] + predicted)
        share.append(ancestry.share[known])
        predicted += len(entry.link.moves.change)
    return Ancestry(np.concatenate(child), np.concatenate(parent), np.concatenate(share))
