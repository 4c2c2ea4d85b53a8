"""The updates of all targets within a window, each linked to the one that it continues.

A turning radar makes many small scans, each with the few targets that the antenna passed. The
hypotheses of all scans are therefore rows of the same tables, which grow at the end. Smoothed rows
stay there, so that a scan costs only the smoothing of the targets that it updated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, contains, run_starts
from ..window.entries import Entry, Source
from .algebra.hindsight import Edges, Gaussians, Pairs, Predicted, Updates, go_back
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry

# The tables are filled again when hypotheses of dropped entries are more than those of the window
# by this number.
MOST_DROPPED = 1024


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses."""

    # From the earlier hypotheses of all sources of the scan, concatenated, to the predicted ones.
    moves: Moves
    ancestry: Ancestry  # From the predicted hypotheses to the kept ones


class _Table:
    """Columns of equal length that grow at the end."""

    def __init__(self) -> None:
        self.size = 0
        self._columns: list[Any] = []  # With room for more rows

    @property
    def columns(self) -> list[Any]:
        """The columns."""
        return [column[: self.size] for column in self._columns]

    def append(self, *columns: Any) -> None:
        """Append rows."""
        begin, self.size = self.size, self.size + len(columns[0])
        if not self._columns or self.size > len(self._columns[0]):
            roomy = [np.empty((2 * self.size, *own.shape[1:]), own.dtype) for own in columns]
            for before, own in zip(self._columns, roomy, strict=False):
                own[:begin] = before[:begin]
            self._columns = roomy
        for own, new in zip(self._columns, columns, strict=True):
            own[begin : self.size] = new


class _Place(NamedTuple):
    """The place of an entry in the tables."""

    stored: Mixture
    rows: slice
    update: IntArray  # The update of each row


class Around(NamedTuple):
    """The updates around a stamp of the T targets that exist then."""

    before: IntArray  # Latest update up to the stamp, (T,)
    after: IntArray  # First later update; -1 for none, (T,)


class Lineages:
    """The updates of the entries of a window, oldest first."""

    def __init__(self) -> None:
        self._places: dict[int, _Place] = {}  # By stamp, ascending
        self._pairs_of_modes: tuple[IntArray, IntArray] | None = None
        self._updates = _Table()  # The columns of `Updates`, and each one's stamp and label
        none, pairs = np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
        self._updates.append(none, pairs, pairs, pairs, none, none)
        self._done = 0  # Number of updates that have been smoothed
        self._edges, self._predicted, self._pairs = _Table(), _Table(), _Table()
        self._filtered, self._smoothed = _Table(), _Table()
        self._tables = (
            *(self._updates, self._edges, self._predicted, self._pairs),
            *(self._filtered, self._smoothed),
        )

    def extend(self, window: Sequence[Entry[Mixture, Link]]) -> None:
        """Append the new entries of a window; begin again if it does not continue these entries."""
        if not self._continued_by(window):
            self._places.clear()
            self._done = 0
            for table in self._tables:
                table.size = 0
        for entry in window:
            if entry.stamp_ns not in self._places:
                self._append(entry)

    def _continued_by(self, window: Sequence[Entry[Mixture, Link]]) -> bool:
        """Return whether a window has these entries, except dropped ones, and then later ones."""
        places, latest = self._places, next(reversed(self._places), -1)
        known = [entry for entry in window if entry.stamp_ns <= latest]
        kept = sum(len(entry.stored) for entry in known)
        return (
            bool(known)
            and known[-1].stamp_ns == latest
            and self._filtered.size <= 2 * kept + MOST_DROPPED
            and all(
                entry.stamp_ns in places and places[entry.stamp_ns].stored is entry.stored
                for entry in known
            )
        )

    def smooth(self, since_ns: int = -1) -> None:
        """Smooth the updates that new ones continue, if a stamp from this one on needs them.

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
        first, self._done = self._done, self._updates.size
        if self._pairs_of_modes is None or first == self._done:
            return
        before, row, predicted, edge, stamp, _ = self._updates.columns
        needed = stamp > since_ns
        needed[self.around(since_ns).before] = True
        go_back(
            *self._pairs_of_modes,
            first,
            np.argsort(-stamp, kind="stable"),
            needed,
            Updates(before, row, predicted, edge),
            Edges(*self._edges.columns),
            Predicted(*self._predicted.columns),
            Pairs(*self._pairs.columns),
            Gaussians(*self._filtered.columns),
            Gaussians(*self._smoothed.columns),
        )

    def smoothed(self, stamp_ns: int) -> Mixture:
        """Return the smoothed hypotheses of an entry."""
        place = self._places[stamp_ns]
        columns = (column[place.rows].copy() for column in self._smoothed.columns)
        return place.stored.with_gaussians(*columns)

    def around(self, stamp_ns: int) -> Around:
        """Return the updates around a stamp."""
        before, row, _, _, stamp, _ = self._updates.columns
        past = int(stamp.searchsorted(stamp_ns, side="right"))
        alive = row[:, 1] > row[:, 0]
        continues = np.flatnonzero(before >= 0)
        earlier, later = (
            continues[: continues.searchsorted(past)],
            continues[continues.searchsorted(past) :],
        )
        after = np.full(past, -1)
        later = later[alive[later] & (before[later] < past)]
        after[before[later]] = later
        alive[before[earlier]] = False
        latest = np.flatnonzero(alive[:past])
        return Around(latest, after[latest])

    def stamps(self, updates: IntArray) -> IntArray:
        """Return the stamps of updates."""
        stamps: IntArray = self._updates.columns[4][updates]
        return stamps

    def labels(self, updates: IntArray) -> IntArray:
        """Return the labels of the targets of updates."""
        labels: IntArray = self._updates.columns[5][updates]
        return labels

    def hypotheses(
        self, updates: IntArray
    ) -> tuple[IntArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Return the smoothed hypotheses of updates, and the place of the update of each."""
        begin, end = self._updates.columns[1][updates].T
        size = end - begin
        of = np.arange(len(updates)).repeat(size)
        row = np.arange(len(of)) + (begin - np.cumsum(size) + size)[of]
        weight, mean, covariance = (column[row] for column in self._smoothed.columns)
        return of, (weight, mean, covariance)

    def _append(self, entry: Entry[Mixture, Link]) -> None:
        """Append the updates of an entry: those of its targets, and of those that it dropped."""
        stored, first, update = entry.stored, self._filtered.size, self._updates.size
        begin = run_starts(stored.row_label)
        size = np.diff(np.append(begin, len(stored)))
        row = np.stack([begin, begin + size], axis=1)
        label, link = stored.row_label[begin], entry.link
        before, predicted, dropped = self._continued(entry, label)
        label = np.concatenate([label, dropped])
        row = np.concatenate([row, np.zeros((len(dropped), 2), dtype=np.int64)])
        edge = np.zeros_like(row)
        if link is not None and (before >= 0).any():
            edge = self._edges.size + link.ancestry.child.searchsorted(row)
            self._append_link(link)
        else:
            predicted = edge
        stamp = np.full(len(label), entry.stamp_ns)
        self._updates.append(before, first + row, predicted, edge, stamp, label)
        for table in (self._filtered, self._smoothed):
            table.append(*stored.gaussians)
        of = update + np.arange(len(begin)).repeat(size)
        self._places[entry.stamp_ns] = _Place(stored, slice(first, self._filtered.size), of)

    def _continued(
        self, entry: Entry[Mixture, Link], label: IntArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Return the columns `before` and `predicted` of an entry, and the targets it dropped.

        `label` has the entry's targets; the rows of those that it dropped come after theirs.
        """
        nobody = np.zeros(0, dtype=np.int64)
        earlier = np.concatenate([nobody, *map(self._updates_of, entry.sources)])
        begin = run_starts(earlier)
        end = np.append(begin[1:], len(earlier))[: len(begin)]
        # The last one stands for targets that continue none.
        before = np.append(earlier[begin], -1)
        predicted = self._predicted.size + np.stack(
            [np.append(begin, 0), np.append(end, 0)], axis=1
        )
        known = np.flatnonzero(before >= 0)
        known = known[np.argsort(self.labels(before[known]))]
        known_label = self.labels(before[known])
        of = np.full(len(label), len(begin))
        kept = contains(known_label, label)
        of[kept] = known[known_label.searchsorted(label[kept])]
        dropped = ~contains(np.sort(label), known_label)
        of = np.concatenate([of, known[dropped]])
        return before[of], predicted[of], known_label[dropped]

    def _updates_of(self, source: Source) -> IntArray:
        """Return the update of each row of a source; -1 if it has left the window."""
        if source.stamp_ns not in self._places:
            return np.full(source.size, -1)
        update = self._places[source.stamp_ns].update
        return update if source.rows is None else update[source.rows]

    def _append_link(self, link: Link) -> None:
        """Append the columns of a link, with the rows that they refer to counted in the tables."""
        moves, one = link.moves, link.ancestry
        parent = np.where(one.parent >= 0, self._predicted.size + one.parent, -1)
        place = np.where(moves.place >= 0, self._pairs.size + moves.place, -1)
        self._edges.append(self._filtered.size + one.child, parent, one.share)
        self._predicted.append(moves.change, moves.survival, place)
        self._pairs.append(moves.mean, moves.factor, moves.gain, moves.base)
        self._pairs_of_modes = moves.pairs
