"""The updates of all targets within a window, each linked to the one that it continues.

A turning radar makes many small scans, each with the few targets that the antenna passed. The
hypotheses of all scans are therefore rows of the same tables, in which those of a new scan replace
those of dropped ones. Smoothed rows stay there, so that a scan costs only the smoothing of the
targets that it updated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...window.entries import Entry, Source
from ..mixture import Mixture
from ..prediction import Moves
from ..reduction import Ancestry
from .backward_step import Edges, Gaussians, Pairs, Predicted, go_back
from .ring import Ring, ring_for
from .updates import (
    COLUMNS,
    LABEL,
    STAMP,
    find_reportable,
    hypothesis_rows,
    make_updates,
    updates_around,
)


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses."""

    # From the earlier hypotheses of all sources of the scan, concatenated, to the predicted ones.
    moves: Moves
    ancestry: Ancestry  # From the predicted hypotheses to the kept ones


class _Place(NamedTuple):
    """The place of an entry in the tables."""

    stored: Mixture
    rows: slice
    updates: int  # Number of updates
    linked: bool


class Around(NamedTuple):
    """The updates around a stamp of the T targets that exist then."""

    before: IntArray  # Latest update up to the stamp, (T,)
    after: IntArray  # First later update; -1 for none, (T,)


def _link_columns(link: Link) -> tuple[Sequence[Any], ...]:
    """Return the columns of each table for a link: predicted ones, pairs, factors and edges."""
    moves, ancestry = link.moves, link.ancestry
    predicted = moves.change, moves.survival, moves.place
    pairs = moves.mean, moves.factored, moves.gain, moves.base
    return predicted, pairs, (moves.factor,), (ancestry.child, ancestry.parent, ancestry.share)


def _count_until(window: Sequence[Entry[Mixture, Link]], stamp_ns: int) -> int:
    """Return the number of entries of a window up to a stamp; most are."""
    count = len(window)
    while count and window[count - 1].stamp_ns > stamp_ns:
        count -= 1
    return count


class Lineages:
    """The updates of the entries of a window, oldest first."""

    def __init__(self) -> None:
        self._reset()

    def _reset(self) -> None:
        """Drop everything."""
        self._places: dict[int, _Place] = {}  # By stamp, ascending
        self._updates = np.zeros((0, COLUMNS), dtype=np.int64)
        self._dropped = 0  # Number of the first update
        self._done = 0  # Number of updates, dropped ones included, that have been smoothed
        self._threshold = 1.0  # Existence up to which targets have been left out
        self._gaussians = Ring(0, ())  # Filtered and smoothed ones
        self._links: tuple[Ring, ...] = ()  # Predicted hypotheses, pairs, factors and edges
        self._pairs_of_modes: tuple[IntArray, ...] = ()  # See `Moves.pairs`

    def extend(self, window: Sequence[Entry[Mixture, Link]]) -> None:
        """Append the new entries of a window; begin again if it does not continue these entries."""
        latest_ns = next(reversed(self._places), -1)
        new_entries = window[_count_until(window, latest_ns) :]
        if self._is_continued_by(window):
            self._drop_before(window[0].stamp_ns)
            if all(map(self._append, new_entries)):
                return
        self._reset()
        self._make_room(window)
        for entry in window:
            self._append(entry)

    def _is_continued_by(self, window: Sequence[Entry[Mixture, Link]]) -> bool:
        """Return whether a window has these entries, except dropped ones, and then later ones.

        An entry depends on all before it, so that the latest one shows whether any has changed.
        """
        if not self._places:
            return False
        latest_ns, latest = next(reversed(self._places.items()))
        count = _count_until(window, latest_ns)
        return (
            count > 0
            and window[0].stamp_ns in self._places
            and window[count - 1].stored is latest.stored
        )

    def _drop_before(self, stamp_ns: int) -> None:
        """Drop the entries before a stamp."""
        first = self._dropped
        for dropped_ns in [entry_ns for entry_ns in self._places if entry_ns < stamp_ns]:
            place = self._places.pop(dropped_ns)
            self._dropped += place.updates
            for ring in (self._gaussians, *(self._links if place.linked else ())):
                ring.drop()
        self._updates = self._updates[self._dropped - first :]

    def _make_room(self, window: Sequence[Entry[Mixture, Link]]) -> None:
        """Make tables with room for the entries of a window."""
        links = [_link_columns(entry.link) for entry in window if entry.link is not None]
        self._gaussians = ring_for([2 * entry.stored.gaussians for entry in window])
        self._links = tuple(map(ring_for, zip(*links, strict=True)))

    def smooth(self, since_ns: int = -1, threshold: float = -1.0) -> Around:
        """Smooth the updates that new ones continue, if a stamp from this one on needs them.

        Returns the updates around that stamp, without targets whose existence probability cannot
        exceed the threshold: these are not smoothed.

        Notes
        -----
        A later mode j divides its smoothed weight among the pairs (i, j) of earlier modes i in
        proportion to w_i P_s pi_ij N(m_j; m_ij, P_ij), where m_j is the smoothed mean and m_ij,
        P_ij are the pair's predicted mean and covariance. The state of a pair follows by a backward
        step from the smoothed later state: the expectation correction. Without the normal density
        this is Kim's smoother, whose error grows with the lag; in a turn the growth cancels its
        gain. The weight of targets that die has the factor of a Bernoulli target's death,
        (1 - smoothed survivors) / (1 - filtered survivors).

        References
        ----------
        Barber, "Expectation correction for smoothed inference in switching linear dynamical
        systems", Journal of Machine Learning Research 7, 2006.
        Kim, "Dynamic linear models with Markov-switching", Journal of Econometrics 60, 1994.
        """
        around = self.around(since_ns)
        if threshold < self._threshold:
            self._done = 0  # targets that were left out may be reported now
        self._threshold = threshold
        first, self._done = self._done, self._dropped + len(self._updates)
        if not self._links:
            return around
        needed = self._updates[:, STAMP] > since_ns
        needed[around.before] = True
        predicted, pairs, factors, edges = (ring.columns for ring in self._links)
        columns, updates = self._gaussians.columns, (self._dropped, self._updates)
        needed &= find_reportable(threshold, needed, *updates, columns[0], predicted[1])
        is_needed = needed[around.before]
        around = Around(around.before[is_needed], around.after[is_needed])
        if first == self._done:
            return around
        from_mode, to_mode = self._pairs_of_modes
        go_back(
            from_mode,
            to_mode,
            first - self._dropped,
            self._dropped,
            needed,
            self._updates,
            Edges(*edges),
            Predicted(*predicted),
            Pairs(*pairs, *factors),
            Gaussians(*columns[:3]),
            Gaussians(*columns[3:]),
        )
        return around

    def smoothed(self, stamp_ns: int) -> Mixture:
        """Return the smoothed hypotheses of an entry."""
        place = self._places[stamp_ns]
        columns = self._gaussians.columns[3:]
        weight, mean, covariance = (column[place.rows].copy() for column in columns)
        return place.stored.changed(weight=weight, mean=mean, covariance=covariance)

    def around(self, stamp_ns: int) -> Around:
        """Return the updates around a stamp."""
        past = int(self._updates[:, STAMP].searchsorted(stamp_ns, side="right"))
        latest, after = updates_around(self._updates, self._dropped, past)
        rows = latest.nonzero()[0]
        return Around(rows, after[rows])

    def stamps(self, updates: IntArray) -> IntArray:
        """Return the stamps of updates."""
        stamps: IntArray = self._updates[updates, STAMP]
        return stamps

    def labels(self, updates: IntArray) -> IntArray:
        """Return the labels of the targets of updates."""
        labels: IntArray = self._updates[updates, LABEL]
        return labels

    def hypotheses(
        self, updates: IntArray
    ) -> tuple[IntArray, IntArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Return the place of the update and the row of each smoothed hypothesis of updates.

        The rows are those of the returned Gaussians.
        """
        weight, mean, covariance = self._gaussians.columns[3:]
        return *hypothesis_rows(updates, self._updates), (weight, mean, covariance)

    def _append(self, entry: Entry[Mixture, Link]) -> bool:
        """Append the updates of an entry: those of its targets, and of those that it dropped.

        Returns whether there is room.
        """
        stored, link = entry.stored, entry.link
        child = continued = np.zeros(0, dtype=np.int64)
        first = np.zeros(5, dtype=np.int64)
        first[0] = self._gaussians.append(*stored.gaussians, *stored.gaussians)
        if link is not None:
            if not self._links:
                return False
            child, self._pairs_of_modes = link.ancestry.child, link.moves.pairs
            continued = np.concatenate([continued, *map(self._labels_of, entry.sources)])
            columns = zip(self._links, _link_columns(link), strict=True)
            first[1:] = [ring.append(*values) for ring, values in columns]
        if first.min() < 0:
            return False
        label = np.union1d(stored.label, continued[continued >= 0])
        row_update = label.searchsorted(stored.row_label)
        of_label = np.where(continued < 0, -1, label.searchsorted(continued))
        updates = make_updates(
            *(entry.stamp_ns, label, row_update, of_label, child, first),
            *(self._dropped, self._updates),
        )
        rows = slice(int(first[0]), int(first[0]) + len(stored))
        place = _Place(stored, rows, len(updates), link is not None)
        self._places[entry.stamp_ns] = place
        self._updates = np.concatenate((self._updates, updates))
        return True

    def _labels_of(self, source: Source) -> IntArray:
        """Return the label of each row of a source; -1 if it has left the window."""
        if source.stamp_ns not in self._places:
            return np.full(source.size, -1)
        label = self._places[source.stamp_ns].stored.row_label
        return label if source.rows is None else label[source.rows]
