"""The updates of all targets within a window, each linked to the one that it continues.

A turning radar makes many small scans, each with the few targets that the antenna passed. The
hypotheses of all scans are therefore rows of the same tables, in which those of a new scan replace
those of dropped ones. Smoothed rows stay there, so that a scan costs only the smoothing of the
targets that it updated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..bisection import count_below
from ..compilation import Bool1, Float2, Float3, Int1, Int2, compiled
from ..window.entries import Entry, Source
from .algebra.backward_step import (
    BEFORE,
    COLUMNS,
    EDGE,
    FIRST_ROW,
    LABEL,
    PREDICTED,
    ROW,
    STAMP,
    Edges,
    Gaussians,
    Pairs,
    Predicted,
    go_back,
)
from .algebra.vectors import total_of
from .mixture import Mixture
from .prediction import Moves
from .reduction import Ancestry

# Room of the tables, as a multiple of the window's rows when they are made, beside the largest
# scan's, which may not fit before the end; and the least room, of which a few targets take little.
ROOM, LEAST_ROOM = 1.2, 1024
# Bound on the rounding of an existence probability.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Link:
    """The link from the hypotheses of a scan back to earlier hypotheses."""

    # From the earlier hypotheses of all sources of the scan, concatenated, to the predicted ones.
    moves: Moves
    ancestry: Ancestry  # From the predicted hypotheses to the kept ones


class _Ring:
    """Columns of equal length in which the rows of a scan are adjacent, and replace the oldest."""

    def __init__(self, room: int, columns: Sequence[Any]) -> None:
        self.columns = [np.empty((room, *column.shape[1:]), column.dtype) for column in columns]
        self._room = room
        # First row and end of each scan, oldest first.
        self._scans: deque[tuple[int, int]] = deque()

    def append(self, *columns: Any) -> int:
        """Append the rows of a scan; return the first one, or -1 if there is no room."""
        oldest, begin = (self._scans[0][0], self._scans[-1][1]) if self._scans else (0, 0)
        size, room = len(columns[0]), self._room
        if begin < oldest:
            room = oldest - 1  # a ring that is full would seem empty
        elif begin + size > room:
            begin, room = 0, oldest - 1
        if begin + size > room:
            return -1
        self._scans.append((begin, begin + size))
        for column, values in zip(self.columns, columns, strict=True):
            column[begin : begin + size] = values
        return begin

    def drop(self) -> None:
        """Drop the rows of the oldest scan."""
        self._scans.popleft()


class _Place(NamedTuple):
    """The place of an entry in the tables."""

    stored: Mixture
    rows: slice
    update: IntArray  # Number of the update of each row
    updates: int  # Number of updates
    linked: bool


class Around(NamedTuple):
    """The updates around a stamp of the T targets that exist then."""

    before: IntArray  # Latest update up to the stamp, (T,)
    after: IntArray  # First later update; -1 for none, (T,)


@compiled
def _make_updates(
    stamp_ns: int,
    label: Int1,
    target: Int1,
    continued: Int1,
    dropped: int,
    existing: Int2,
    child: Int1,
    first: Int1,
) -> IntArray:
    """Return the updates of a scan: those of its targets, and then of those that it dropped.

    Parameters
    ----------
    label : int array of shape (T,)
        Labels of the targets, ascending.
    target : int array of shape (H,)
        Target of each updated hypothesis.
    continued : int array of shape (E,)
        Number of the update of each hypothesis that the scan continues; -1 if it has left the
        window.
    dropped, existing : int, and int array of shape (U, COLUMNS)
        The number of the first earlier update, and all of them.
    child : int array
        Updated hypothesis of each edge.
    first : int array
        First rows of the scan: of hypotheses, predicted ones, pairs, factors and edges.
    """
    count, update, latest = len(label), -1, -1
    updates = np.zeros((len(label) + len(continued), COLUMNS), np.int64)
    for index in range(count):
        updates[index, LABEL] = label[index]
        updates[index, BEFORE] = -1
    # Backwards, so that the first row of each target stays.
    for row in range(len(target) - 1, -1, -1):
        updates[target[row], ROW] = row
    for row in range(len(target)):
        updates[target[row], ROW + 1] = row + 1
    for edge in range(len(child) - 1, -1, -1):
        updates[target[child[edge]], EDGE] = edge
    for edge in range(len(child)):
        updates[target[child[edge]], EDGE + 1] = edge + 1
    for row in range(len(continued)):
        if continued[row] < 0:
            continue
        if continued[row] != latest:
            latest = continued[row]
            target_label = existing[latest - dropped, LABEL]
            update = count_below(label, target_label)
            if update == len(label) or label[update] != target_label:
                update = count
                updates[update, LABEL] = target_label
                count += 1
            updates[update, BEFORE] = latest
            updates[update, PREDICTED] = row
        updates[update, PREDICTED + 1] = row + 1
    # If the scan that updated a target last has been dropped, an earlier one is not its last.
    newest = -1
    for earlier in range(len(existing)):
        newest = max(newest, existing[earlier, LABEL])
    for index in range(count):
        if updates[index, BEFORE] < 0 and updates[index, LABEL] <= newest:
            for earlier in range(len(existing)):
                if existing[earlier, LABEL] == updates[index, LABEL]:
                    updates[index, BEFORE] = dropped + earlier
    for index in range(count):
        updates[index, STAMP] = stamp_ns
        for end in range(2):
            updates[index, ROW + end] += first[0]
            updates[index, PREDICTED + end] += first[1]
            updates[index, EDGE + end] += first[4]
        for table in range(4):
            updates[index, FIRST_ROW + table] = first[table]
    return updates[:count]


@compiled
def _updates_around(updates: Int2, dropped: int, past: int) -> tuple[BoolArray, IntArray]:
    """Return which of the updates up to a stamp are the latest, and the first later ones.

    `past` is the number of updates up to the stamp; -1 stands for no later one.
    """
    latest, after = np.empty(past, np.bool_), np.empty(past, np.int64)
    for index in range(past):
        latest[index] = updates[index, ROW + 1] > updates[index, ROW]
        after[index] = -1
        if updates[index, BEFORE] >= dropped:
            latest[updates[index, BEFORE] - dropped] = False
    for index in range(past, len(updates)):
        continued = updates[index, BEFORE] - dropped
        if 0 <= continued < past and updates[index, ROW + 1] > updates[index, ROW]:
            after[continued] = index
    return latest, after


@compiled
def _find_reportable(
    threshold: float,
    needed: Bool1,
    dropped: int,
    updates: Int2,
    weight: Float3,
    survival: Float2,
) -> BoolArray:
    """Return the updates of targets whose smoothed existence may exceed a threshold.

    It does if the existence at an update that is `needed` may. `weight` and `survival` are those of
    all updated and predicted hypotheses.

    Notes
    -----
    Survivors have at most the smoothed existence e at the next update, and dead targets have the
    factor (1 - e) / (1 - filtered survivors); see `Lineages.smooth`.
    """
    existence, reportable = np.full(len(updates), -1.0), np.zeros(len(updates), np.bool_)
    for index in range(len(updates) - 1, -1, -1):
        if existence[index] < 0.0:  # it is the target's last one
            existence[index] = 0.0
            for row in range(updates[index, ROW], updates[index, ROW + 1]):
                for mode in range(weight.shape[1]):
                    existence[index] += total_of(weight[row, mode])
        reportable[index] = reportable[index] or (
            needed[index] and existence[index] > threshold - ROUNDING
        )
        continued, alive, died, dead = updates[index, BEFORE] - dropped, existence[index], 0.0, 1.0
        if continued < 0:
            continue
        begin, first = updates[continued, ROW], updates[index, PREDICTED]
        for row in range(first, updates[index, PREDICTED + 1]):
            for mode in range(weight.shape[1]):
                row_weight = total_of(weight[begin + row - first, mode])
                died += (1.0 - survival[row, mode]) * row_weight
                dead -= survival[row, mode] * row_weight
        existence[continued] = alive + max(1.0 - alive, 0.0) * (died / dead if dead > 0.0 else 0.0)
        reportable[continued] = reportable[index]
    for index in range(len(updates)):
        continued = updates[index, BEFORE] - dropped
        reportable[index] = reportable[index] or (continued >= 0 and reportable[continued])
    return reportable


@compiled
def _hypothesis_rows(chosen: Int1, updates: Int2) -> tuple[IntArray, IntArray]:
    """Return the place of the update and the row of each hypothesis of chosen updates."""
    count = 0
    for update in chosen:
        count += updates[update, ROW + 1] - updates[update, ROW]
    position, rows, filled = np.empty(count, np.int64), np.empty(count, np.int64), 0
    for index in range(len(chosen)):
        update = chosen[index]
        for row in range(updates[update, ROW], updates[update, ROW + 1]):
            position[filled], rows[filled] = index, row
            filled += 1
    return position, rows


def _link_columns(link: Link) -> tuple[Sequence[Any], ...]:
    """Return the columns of each table for a link: predicted ones, pairs, factors and edges."""
    moves, ancestry = link.moves, link.ancestry
    predicted = moves.change, moves.survival, moves.place
    pairs = moves.mean, moves.factored, moves.gain, moves.base
    return predicted, pairs, (moves.factor,), (ancestry.child, ancestry.parent, ancestry.share)


def _ring_for(parts: Sequence[Sequence[Any]]) -> _Ring:
    """Return a ring with room for parts that have these columns."""
    sizes = [len(columns[0]) for columns in parts]
    return _Ring(max(round(ROOM * sum(sizes)) + max(sizes), LEAST_ROOM), parts[0])


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
        self._gaussians = _Ring(0, ())  # Filtered and smoothed ones
        self._links: tuple[_Ring, ...] = ()  # Predicted hypotheses, pairs, factors and edges
        self._pairs_of_modes: tuple[IntArray, ...] = ()  # See `Moves.pairs`

    def extend(self, window: Sequence[Entry[Mixture, Link]]) -> None:
        """Append the new entries of a window; begin again if it does not continue these entries."""
        latest_ns = next(reversed(self._places), -1)
        new = window[_count_until(window, latest_ns) :]
        if self._is_continued_by(window):
            self._drop_before(window[0].stamp_ns)
            if all(map(self._append, new)):
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
        self._gaussians = _ring_for([2 * entry.stored.gaussians for entry in window])
        self._links = tuple(map(_ring_for, zip(*links, strict=True)))

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
        needed &= _find_reportable(threshold, needed, *updates, columns[0], predicted[1])
        kept = needed[around.before]
        around = Around(around.before[kept], around.after[kept])
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
        latest, after = _updates_around(self._updates, self._dropped, past)
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
        return *_hypothesis_rows(updates, self._updates), (weight, mean, covariance)

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
            continued = np.concatenate([continued, *map(self._updates_of, entry.sources)])
            columns = zip(self._links, _link_columns(link), strict=True)
            first[1:] = [ring.append(*values) for ring, values in columns]
        if first.min() < 0:
            return False
        existing = self._dropped, self._updates
        updates = _make_updates(
            *(entry.stamp_ns, stored.label, stored.target, continued, *existing, child, first)
        )
        numbers = self._dropped + len(self._updates) + stored.target
        rows = slice(int(first[0]), int(first[0]) + len(stored))
        place = _Place(stored, rows, numbers, len(updates), link is not None)
        self._places[entry.stamp_ns] = place
        self._updates = np.concatenate((self._updates, updates))
        return True

    def _updates_of(self, source: Source) -> IntArray:
        """Return the update of each row of a source; -1 if it has left the window."""
        if source.stamp_ns not in self._places:
            return np.full(source.size, -1)
        update = self._places[source.stamp_ns].update
        return update if source.rows is None else update[source.rows]
