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

from ..arrays import BoolArray, FloatArray, IntArray
from ..compilation import Int1, Int2, compiled
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
        self.size = self._room = 0
        self._columns: list[Any] = []  # With room for more rows

    @property
    def columns(self) -> list[Any]:
        """The columns' rows so far."""
        return [column[: self.size] for column in self._columns]

    def append(self, *columns: Any) -> None:
        """Append rows."""
        begin, self.size = self.size, self.size + len(columns[0])
        if not self._columns or self.size > self._room:
            self._room = 2 * self.size
            roomy = [np.empty((self._room, *own.shape[1:]), own.dtype) for own in columns]
            for before, own in zip(self._columns, roomy, strict=False):
                own[:begin] = before[:begin]
            self._columns = roomy
        for own, new in zip(self._columns, columns, strict=True):
            own[begin : self.size] = new

    def clear(self) -> None:
        """Drop all rows."""
        self.size = 0


class _Place(NamedTuple):
    """The place of an entry in the tables."""

    stored: Mixture
    rows: slice
    update: IntArray  # The update of each row


class Around(NamedTuple):
    """The updates around a stamp of the T targets that exist then."""

    before: IntArray  # Latest update up to the stamp, (T,)
    after: IntArray  # First later update; -1 for none, (T,)


# Columns of the result of `_updates`; of rows, the first and the end.
LABEL, BEFORE, ROW, PREDICTED, EDGE, COLUMNS = 0, 1, 2, 4, 6, 8


@compiled
def _updates(label: Int1, target: Int1, earlier: Int1, known: Int1, child: Int1) -> IntArray:
    """Return the updates of a scan: those of its targets, and then of those that it dropped.

    The rows of the other tables are counted within the scan.

    Parameters
    ----------
    label : int array of shape (T,)
        Labels of the targets, ascending.
    target : int array of shape (H,)
        Target of each updated hypothesis.
    earlier : int array of shape (E,)
        Update of each hypothesis that the scan continues; -1 if it has left the window.
    known : int array
        Label of each earlier update.
    child : int array
        Updated hypothesis of each edge.
    """
    count, update, latest = len(label), -1, -1
    found = np.zeros((len(label) + len(earlier), COLUMNS), np.int64)
    for one in range(count):
        found[one, LABEL] = label[one]
        found[one, BEFORE] = -1
    # Backwards, so that the first row of each target stays.
    for at in range(len(target) - 1, -1, -1):
        found[target[at], ROW] = at
    for at in range(len(target)):
        found[target[at], ROW + 1] = at + 1
    for at in range(len(child) - 1, -1, -1):
        found[target[child[at]], EDGE] = at
    for at in range(len(child)):
        found[target[child[at]], EDGE + 1] = at + 1
    for at in range(len(earlier)):
        if earlier[at] < 0:
            continue
        if earlier[at] != latest:
            latest = earlier[at]
            update, end = 0, len(label)
            while update < end:
                middle = (update + end) // 2
                if label[middle] < known[latest]:
                    update = middle + 1
                else:
                    end = middle
            if update == len(label) or label[update] != known[latest]:
                update = count
                found[update, LABEL] = known[latest]
                count += 1
            found[update, BEFORE] = latest
            found[update, PREDICTED] = at
        found[update, PREDICTED + 1] = at + 1
    return found[:count]


@compiled
def _around(before: Int1, row: Int2, past: int) -> tuple[BoolArray, IntArray]:
    """Return which of the updates up to a stamp are the latest, and the first later ones.

    `past` is the number of updates up to the stamp; -1 stands for no later one.
    """
    latest, after = np.empty(past, np.bool_), np.empty(past, np.int64)
    for one in range(past):
        latest[one] = row[one, 1] > row[one, 0]
        after[one] = -1
        if before[one] >= 0:
            latest[before[one]] = False
    for one in range(past, len(before)):
        if 0 <= before[one] < past and row[one, 1] > row[one, 0]:
            after[before[one]] = one
    return latest, after


@compiled
def _hypotheses(updates: Int1, row: Int2) -> tuple[IntArray, IntArray]:
    """Return the place of the update and the row of each hypothesis of updates."""
    count = 0
    for one in updates:
        count += row[one, 1] - row[one, 0]
    of, rows, at = np.empty(count, np.int64), np.empty(count, np.int64), 0
    for place in range(len(updates)):
        for own in range(row[updates[place], 0], row[updates[place], 1]):
            of[at], rows[at] = place, own
            at += 1
    return of, rows


def _count_until(window: Sequence[Entry[Mixture, Link]], stamp_ns: int) -> int:
    """Return the number of entries of a window up to a stamp; most are."""
    count = len(window)
    while count and window[count - 1].stamp_ns > stamp_ns:
        count -= 1
    return count


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
                table.clear()
        latest_ns = next(reversed(self._places), -1)
        for entry in window[_count_until(window, latest_ns) :]:
            self._append(entry)

    def _continued_by(self, window: Sequence[Entry[Mixture, Link]]) -> bool:
        """Return whether a window has these entries, except dropped ones, and then later ones.

        An entry depends on all before it, so that the latest one shows whether any has changed. If
        most rows of the tables are of dropped entries, the answer is no.
        """
        if not self._places:
            return False
        latest_ns, latest = next(reversed(self._places.items()))
        known = _count_until(window, latest_ns)
        first = self._places.get(window[0].stamp_ns) if known else None
        return (
            first is not None
            and window[known - 1].stored is latest.stored
            and 2 * first.rows.start <= self._filtered.size + MOST_DROPPED
        )

    def smooth(self, since_ns: int = -1) -> Around:
        """Smooth the updates that new ones continue, if a stamp from this one on needs them.

        Returns the updates around that stamp.

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
        first, self._done = self._done, self._updates.size
        if self._pairs_of_modes is None or first == self._done:
            return around
        before, row, predicted, edge, stamp, _ = self._updates.columns
        needed = stamp > since_ns
        needed[around.before] = True
        go_back(
            *self._pairs_of_modes,
            first,
            (-stamp).argsort(kind="stable"),
            needed,
            Updates(before, row, predicted, edge),
            Edges(*self._edges.columns),
            Predicted(*self._predicted.columns),
            Pairs(*self._pairs.columns),
            Gaussians(*self._filtered.columns),
            Gaussians(*self._smoothed.columns),
        )
        return around

    def smoothed(self, stamp_ns: int) -> Mixture:
        """Return the smoothed hypotheses of an entry."""
        place = self._places[stamp_ns]
        columns = (column[place.rows].copy() for column in self._smoothed.columns)
        return place.stored.with_gaussians(*columns)

    def around(self, stamp_ns: int) -> Around:
        """Return the updates around a stamp."""
        before, row, _, _, stamp, _ = self._updates.columns
        past = int(stamp.searchsorted(stamp_ns, side="right"))
        latest, after = _around(before, row, past)
        place = latest.nonzero()[0]
        return Around(place, after[place])

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
    ) -> tuple[IntArray, IntArray, tuple[FloatArray, FloatArray, FloatArray]]:
        """Return the place of the update and the row of each smoothed hypothesis of updates.

        The rows are those of the returned Gaussians.
        """
        weight, mean, covariance = self._smoothed.columns
        return *_hypotheses(updates, self._updates.columns[1]), (weight, mean, covariance)

    def _append(self, entry: Entry[Mixture, Link]) -> None:
        """Append the updates of an entry: those of its targets, and of those that it dropped."""
        stored, link = entry.stored, entry.link
        nobody = np.zeros(0, dtype=np.int64)
        earlier = np.concatenate([nobody, *map(self._updates_of, entry.sources)])
        child = nobody if link is None else link.ancestry.child
        first, update, known = self._filtered.size, self._updates.size, self._updates.columns[5]
        found = _updates(stored.label, stored.target, earlier, known, child)
        label, before, row = found[:, LABEL], found[:, BEFORE], found[:, ROW:PREDICTED]
        if link is not None and (before >= 0).any():
            predicted = self._predicted.size + found[:, PREDICTED:EDGE]
            edge = self._edges.size + found[:, EDGE:]
            self._append_link(link)
        else:
            predicted = edge = np.zeros_like(row)
        stamp = np.full(len(label), entry.stamp_ns)
        self._updates.append(before, first + row, predicted, edge, stamp, label)
        for table in (self._filtered, self._smoothed):
            table.append(*stored.gaussians)
        rows = slice(first, self._filtered.size)
        self._places[entry.stamp_ns] = _Place(stored, rows, update + stored.target)

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
