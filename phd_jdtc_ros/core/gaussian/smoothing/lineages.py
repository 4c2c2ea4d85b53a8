"""The updates of all targets within a window, each linked to the one that it continues.

A turning radar makes many small scans, each with the few targets that the antenna passed. Smoothed
hypotheses are therefore kept, so that a scan costs only the smoothing of the targets that it
updated. They are in tables, of an entry or of several small ones that follow each other, because a
call of compiled code takes as long as the backward step of several targets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, frozen, read_only
from ..dynamics import ModePairs
from ..entries import Entry, Link, Source
from ..mixture import Gaussians, Mixture
from .backward_step import Links, go_back
from .updates import (
    BEFORE,
    COLUMNS,
    EDGE,
    LABEL,
    ROW,
    STAMP,
    SUMS,
    Continued,
    Updates,
    append_updates,
    hypothesis_rows,
    plan_steps,
)

# Number of tables that are joined at a time, and the largest number of hypotheses of each.
JOINED, LARGEST = 8, 512


@dataclass
class Table:
    """Hypotheses, and the links to earlier ones; both are the arrays of a single entry themselves.

    The smoothed hypotheses are the filtered ones until they are copied, to be changed.
    """

    end: int  # Number of the update after its last one
    filtered: Gaussians
    links: Links | None  # None without earlier hypotheses
    is_small: bool = False  # Whether the table can be joined to others
    smoothed: Gaussians = field(init=False)  # Its arrays are read-only views of `_own`
    _own: Gaussians | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.smoothed = self.filtered

    @property
    def changeable(self) -> Gaussians:
        """The smoothed hypotheses, in arrays of their own."""
        if self._own is None:
            return self.own(Gaussians(*(column.copy() for column in self.filtered)))
        return self._own

    def own(self, smoothed: Gaussians) -> Gaussians:
        """Take these arrays for the smoothed hypotheses, and return them."""
        self._own, self.smoothed = smoothed, Gaussians(*map(read_only, smoothed))
        return smoothed


def _shift(rows: IntArray, begin: IntArray) -> IntArray:
    """Return rows of joined tables, given the begin of each row's own table; -1 remains."""
    return np.where(rows < 0, -1, rows + begin)


def join(tables: Sequence[Table], updates: IntArray, first: int) -> Table:
    """Return a table of the rows of several that have links; their updates get the places there.

    Parameters
    ----------
    updates : int array of shape (U, COLUMNS)
        All updates of the tables, which are changed.
    first : int
        Number of the first of these updates.
    """
    parts = [table.links for table in tables if table.links is not None]
    sizes = np.array(
        [
            [len(table.filtered.weight), *map(len, (own.change, own.child, own.mean, own.factor))]
            for table, own in zip(tables, parts, strict=True)
        ]
    )
    begins = sizes.cumsum(axis=0) - sizes
    counts = np.diff([first, *[table.end for table in tables]])
    updates[:, ROW : EDGE + 2] += begins[:, :3].repeat(counts, axis=0).repeat(2, axis=1)
    _, predicted, edges, pairs, _ = sizes.T
    links = Links(*map(np.concatenate, zip(*parts, strict=True)))
    links = links._replace(
        child=links.child + begins[:, 0].repeat(edges),
        parent=_shift(links.parent, begins[:, 1].repeat(edges)),
        place=_shift(links.place, begins[:, 3].repeat(predicted)[:, None]),
        factored=_shift(links.factored, begins[:, 4].repeat(pairs)),
    )
    filtered, smoothed = (
        Gaussians(*map(np.concatenate, zip(*gaussians, strict=True)))
        for gaussians in zip(*((table.filtered, table.smoothed) for table in tables), strict=True)
    )
    joined = Table(tables[-1].end, frozen(filtered), frozen(links))
    joined.own(smoothed)
    return joined


class Around(NamedTuple):
    """The updates around a stamp of the T targets that exist then."""

    before: IntArray  # Latest update up to the stamp, (T,)
    after: IntArray  # First later update; -1 for none, (T,)


def _links_of(link: Link) -> Links:
    """Return the columns of a link."""
    ancestry, moves = link.ancestry, link.moves
    links = Links(
        ancestry.child,
        ancestry.parent,
        ancestry.share,
        moves.change,
        moves.survival,
        moves.place,
        moves.mean,
        moves.factored,
        moves.gain,
        moves.base,
        moves.factor,
    )
    return frozen(links)


def _count_until(window: Sequence[Entry], stamp_ns: int) -> int:
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
        # The mixture of each entry and the number of its updates, by stamp, ascending.
        self._entries: dict[int, tuple[Mixture, int]] = {}
        self._tables: list[Table] = []  # Oldest first
        self._pairs: ModePairs | None = None  # See `Moves.pairs`
        none = Updates(0, np.zeros((0, COLUMNS), dtype=np.int64), np.zeros((0, SUMS)))
        self._updates = frozen(none)
        self._done = 0  # Number of updates, dropped ones included, that have been smoothed
        self._threshold = 1.0  # Existence up to which targets have been left out

    def extend(self, window: Sequence[Entry]) -> None:
        """Append the new entries of a window; begin again if it does not continue these entries."""
        latest_ns = next(reversed(self._entries), -1)
        new_entries = window[_count_until(window, latest_ns) :]
        if self._is_continued_by(window):
            self.drop_before(window[0].stamp_ns)
        else:
            self._reset()
            new_entries = window
        for entry in new_entries:
            self._append(entry)

    def _is_continued_by(self, window: Sequence[Entry]) -> bool:
        """Return whether a window has these entries, except dropped ones, and then later ones.

        An entry depends on all before it, so that the latest one shows whether any has changed.
        """
        if not self._entries:
            return False
        latest_ns, (latest, _) = next(reversed(self._entries.items()))
        count = _count_until(window, latest_ns)
        return (
            count > 0 and window[0].stamp_ns in self._entries and window[count - 1].stored is latest
        )

    def drop_before(self, stamp_ns: int) -> None:
        """Drop the entries before a stamp."""
        stamps = [entry_ns for entry_ns in self._entries if entry_ns < stamp_ns]
        if not stamps:
            return
        count = sum(self._entries.pop(entry_ns)[1] for entry_ns in stamps)
        dropped, rows, sums = self._updates
        dropped, rows, sums = dropped + count, rows[count:], sums[count:]
        self._updates = Updates(dropped, rows, sums)
        self._tables = [table for table in self._tables if table.end > dropped]
        if self._tables:
            oldest = self._tables[0]
            continued = rows[: oldest.end - dropped, BEFORE]
            if (continued < dropped).all():
                oldest.links, oldest.is_small = None, False

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
        if threshold < self._threshold:
            self._done = 0  # Targets that were left out may be reported now.
        self._threshold = threshold
        before, after, steps, parts = self._plan(since_ns, threshold)
        self._done = self._updates.dropped + len(self._updates.rows)
        for begin, end, later, earlier in parts.tolist():
            table, continued = self._tables[later], self._tables[earlier]
            smoothed = continued.changeable
            if self._pairs is not None and table.links is not None:
                go_back[smoothed.mean.shape[2]](
                    self._pairs,
                    steps[begin:end],
                    self._updates,
                    table.links,
                    table.smoothed,
                    continued.filtered,
                    smoothed,
                )
        return Around(before, after)

    def _plan(
        self, since_ns: int, threshold: float
    ) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return the updates around a stamp and the steps back from new ones; see `plan_steps`."""
        first = self._done - self._updates.dropped
        return plan_steps(since_ns, threshold, first, self._updates, self._ends)

    @property
    def _ends(self) -> IntArray:
        """The number of the update after the last one of each table."""
        return np.array([table.end for table in self._tables], dtype=np.int64)

    def smoothed(self, stamp_ns: int) -> Mixture:
        """Return the smoothed hypotheses of an entry."""
        of_entry = np.flatnonzero(self._updates.rows[:, STAMP] == stamp_ns)
        _, row, columns = self.hypotheses(of_entry)
        weight, mean, covariance = (column.take(np.sort(row), axis=0) for column in columns)
        stored, _ = self._entries[stamp_ns]
        return stored.changed(weight=weight, mean=mean, covariance=covariance)

    def around(self, stamp_ns: int) -> Around:
        """Return the updates around a stamp."""
        before, after, _, _ = self._plan(stamp_ns, -1.0)
        return Around(before, after)

    def stamps(self, updates: IntArray) -> IntArray:
        """Return the stamps of updates, nanoseconds, given their indices in the window."""
        stamps: IntArray = self._updates.rows[updates, STAMP]
        return stamps

    def labels(self, updates: IntArray) -> IntArray:
        """Return the labels of the targets of updates."""
        labels: IntArray = self._updates.rows[updates, LABEL]
        return labels

    def hypotheses(self, updates: IntArray) -> tuple[IntArray, IntArray, Gaussians]:
        """Return the place of the update and the row of each smoothed hypothesis of updates.

        The rows are those of the returned Gaussians.
        """
        place, row, counts = hypothesis_rows(updates, self._updates, self._ends)
        (used,) = counts.nonzero()
        if used.size < 2:
            latest, _ = next(reversed(self._entries.values()))
            return place, row, self._tables[used[0]].smoothed if used.size else latest.gaussians
        parts, end = [], 0
        for index in used.tolist():
            begin, end = end, end + counts[index]
            parts.append([c.take(row[begin:end], axis=0) for c in self._tables[index].smoothed])
        joined = Gaussians(*map(np.concatenate, zip(*parts, strict=True)))
        return place, np.arange(len(row)), frozen(joined)

    def _append(self, entry: Entry) -> None:
        """Append the updates of an entry: those of its targets, and of those that it dropped."""
        stored, link, links = entry.stored, entry.link, None
        if link is None:
            child = label = np.zeros(0, dtype=np.int64)
            before, survival = stored.weight[:0], np.zeros((0, stored.weight.shape[1]))
        else:
            child, survival = link.ancestry.child, link.moves.survival
            self._pairs, links = link.moves.pairs, _links_of(link)
            parts = [self._rows_of(source, stored.weight) for source in entry.sources]
            label, before = map(np.concatenate, zip(*parts, strict=True))
        ordered = np.concatenate((stored.row_label, label))
        ordered.sort()
        continued = frozen(Continued(label, before, survival))
        first, dropped = len(self._updates.rows), self._updates.dropped
        rows, sums = append_updates(
            entry.stamp_ns,
            stored.row_label,
            stored.weight,
            child,
            continued,
            ordered,
            self._updates,
        )
        self._entries[entry.stamp_ns] = stored, len(rows) - first
        if len(rows) > first:
            is_small = links is not None and len(stored.weight) <= LARGEST
            self._tables.append(Table(dropped + len(rows), stored.gaussians, links, is_small))
            self._join_small(rows)
        self._updates = frozen(Updates(dropped, rows, sums))

    def _join_small(self, rows: IntArray) -> None:
        """Join the latest tables if all are small, and change the rows of their updates."""
        latest, dropped = self._tables[-JOINED:], self._updates.dropped
        if len(latest) == JOINED and all(map(attrgetter("is_small"), latest)):
            del self._tables[-JOINED:]
            first = self._tables[-1].end if self._tables else dropped
            self._tables.append(join(latest, rows[first - dropped :], first))

    def _rows_of(self, source: Source, weight: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the labels and weights of a source's rows; -1 and 0 if it has left the window."""
        if source.stamp_ns not in self._entries:
            return np.full(source.size, -1), np.zeros((source.size, *weight.shape[1:]))
        (stored, _), rows = self._entries[source.stamp_ns], source.rows
        if rows is None:
            return stored.row_label, stored.weight
        return stored.row_label[rows], stored.weight[rows]
