"""The updates of single targets: rows of one table, each with the rows of others that it has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...bisection import count_below
from ...compilation import Float2, Float3, Int1, Int2, compiled, inner
from ..algebra.blocks import total_of

# Columns of the U updates of single targets, oldest first, (U, COLUMNS): the stamp, the label, and
# the number of the update that each continues, -1 for none. Then the first row and the end, among
# those of the scan, of its updated hypotheses, of the predicted ones, and of the edges between.
STAMP, LABEL, BEFORE, ROW, PREDICTED, EDGE, COLUMNS = 0, 1, 2, 3, 5, 7, 9
# Columns of the sums of an update's hypotheses, (U, SUMS): the filtered existence probability, and
# the probabilities that the target died since the update before, and that it does not exist now.
EXISTENCE, DIED, DEAD, SUMS = 0, 1, 2, 3
# Bound on the rounding of an existence probability.
ROUNDING = 1e-9


class Updates(NamedTuple):
    """The U updates of single targets within a window, oldest first."""

    dropped: int  # Number of the first one
    rows: Int2  # (U, COLUMNS)
    sums: Float2  # (U, SUMS)


class Continued(NamedTuple):
    """The P earlier hypotheses that a scan continues."""

    label: Int1  # -1 for those that have left the window, (P,)
    weight: Float3  # 0 for those that have left the window, (P, R, C)
    survival: Float2  # See `Moves`, (P, R)


@inner
def _extend_rows(update: IntArray, column: int, row: int) -> None:
    """Extend an update's rows in another table by the next one."""
    if update[column + 1] == 0:
        update[column] = row
    update[column + 1] = row + 1


@compiled
def append_updates(
    stamp_ns: int,
    row_label: Int1,
    weight: Float3,
    child: Int1,
    continued: Continued,
    ordered: Int1,
    earlier: Updates,
) -> tuple[IntArray, FloatArray]:
    """Return rows and sums of all updates, with those of a scan: of its targets and dropped ones.

    Parameters
    ----------
    row_label, weight : int array of shape (H,), and array of shape (H, R, C)
        Label and weights of each updated hypothesis.
    child : int array of shape (E,)
        Updated hypothesis of each edge.
    continued : Continued
    ordered : int array of shape (H + P,)
        The labels of the updated and the continued hypotheses, ascending.
    earlier : Updates
    """
    dropped, existing, existing_sums = earlier
    first, label, count = len(existing), np.empty(len(ordered), np.int64), 0
    for value in ordered:
        if value >= 0 and (count == 0 or value != label[count - 1]):
            label[count] = value
            count += 1
    label = label[:count]
    updates, sums = np.zeros((first + count, COLUMNS), np.int64), np.zeros((first + count, SUMS))
    for number in range(first, first + count):
        updates[number, STAMP], updates[number, LABEL] = stamp_ns, label[number - first]
        updates[number, BEFORE], sums[number, DEAD] = -1, 1.0
    for number in range(first):
        for column in range(COLUMNS):
            updates[number, column] = existing[number, column]
        for column in range(SUMS):
            sums[number, column] = existing_sums[number, column]
        index = count_below(label, existing[number, LABEL])
        if index < count and label[index] == existing[number, LABEL]:
            updates[first + index, BEFORE] = dropped + number  # The last one stays.
    row_update = np.empty(len(row_label), np.int64)
    for row in range(len(row_label)):
        number = row_update[row] = first + count_below(label, row_label[row])
        _extend_rows(updates[number], ROW, row)
        for mode in range(weight.shape[1]):
            sums[number, EXISTENCE] += total_of(weight[row, mode])
    of_row, before, survival = continued
    for row in range(len(of_row)):
        number = first + count_below(label, of_row[row])
        if of_row[row] >= 0:
            _extend_rows(updates[number], PREDICTED, row)
            for mode in range(before.shape[1]):
                row_weight = total_of(before[row, mode])
                sums[number, DIED] += (1.0 - survival[row, mode]) * row_weight
                sums[number, DEAD] -= survival[row, mode] * row_weight
    for edge in range(len(child)):
        _extend_rows(updates[row_update[child[edge]]], EDGE, edge)
    return updates, sums


@inner
def _updates_around(updates: IntArray, dropped: int, past: int) -> tuple[BoolArray, IntArray]:
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


@inner
def _find_reportable(
    threshold: float, needed: BoolArray, dropped: int, updates: IntArray, sums: FloatArray
) -> BoolArray:
    """Return the updates of targets whose smoothed existence may exceed a threshold.

    It does if the existence at an update that is `needed` may.

    Notes
    -----
    Survivors have at most the smoothed existence e at the next update, and dead targets have the
    factor (1 - e) / (1 - filtered survivors); see `Lineages.smooth`.
    """
    existence, reportable = np.full(len(updates), -1.0), np.zeros(len(updates), np.bool_)
    for index in range(len(updates) - 1, -1, -1):
        if existence[index] < 0.0:  # It is the target's last one.
            existence[index] = sums[index, EXISTENCE]
        reportable[index] = reportable[index] or (
            needed[index] and existence[index] > threshold - ROUNDING
        )
        continued, alive = updates[index, BEFORE] - dropped, existence[index]
        if continued >= 0:
            died, dead = sums[index, DIED], sums[index, DEAD]
            death = died / dead if dead > 0.0 else 0.0
            existence[continued] = alive + max(1.0 - alive, 0.0) * death
            reportable[continued] = reportable[index]
    for index in range(len(updates)):
        continued = updates[index, BEFORE] - dropped
        reportable[index] = reportable[index] or (continued >= 0 and reportable[continued])
    return reportable


@inner
def _find_steps(first: int, needed: BoolArray, dropped: int, updates: IntArray) -> IntArray:
    """Return the updates from which a step back to a `needed` one is due, ascending.

    These are the new ones, from `first` on, and those that steps from later ones change.
    """
    changed, steps, count = np.zeros(len(updates), np.bool_), np.empty(len(updates), np.int64), 0
    for index in range(len(updates) - 1, -1, -1):
        continued = updates[index, BEFORE] - dropped
        if continued < 0 or updates[index, PREDICTED] == updates[index, PREDICTED + 1]:
            continue
        if needed[continued] and (changed[index] or index >= first):
            changed[continued] = True
            count += 1
            steps[len(steps) - count] = index
    return steps[len(steps) - count :]


@inner
def _in_order(steps: IntArray, dropped: int, updates: IntArray, ends: IntArray) -> IntArray:
    """Write steps, ascending, in the order of `plan_steps`; return its `parts`."""
    parts, found, filled, ascending = np.empty((len(steps), 4), np.int64), 0, 0, steps.copy()
    last = len(ascending)
    while last > 0:
        later, first = count_below(ends, dropped + ascending[last - 1] + 1), last
        while first > 0 and count_below(ends, dropped + ascending[first - 1] + 1) == later:
            first -= 1
        for earlier in range(later, -1, -1):
            part_begin, end = filled, last
            while end > first:
                begin = end - 1
                stamp_ns = updates[ascending[begin], STAMP]
                while begin > first and updates[ascending[begin - 1], STAMP] == stamp_ns:
                    begin -= 1
                for place in range(begin, end):
                    continued = updates[ascending[place], BEFORE]
                    if count_below(ends, continued + 1) == earlier:
                        steps[filled] = ascending[place]
                        filled += 1
                end = begin
            if filled > part_begin:
                parts[found, 0], parts[found, 1] = part_begin, filled
                parts[found, 2], parts[found, 3] = later, earlier
                found += 1
        last = first
    return parts[:found]


@compiled
def plan_steps(
    since_ns: int, threshold: float, first: int, known: Updates, ends: Int1
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return the updates around a stamp, and the steps back that a stamp from this one on needs.

    Targets whose existence probability cannot exceed the threshold are left out. `first` is the
    index of the first new update, and `ends` has the number of the update after the last one of
    each table, (A,).

    Returns
    -------
    before, after : int arrays of shape (T,)
        See `lineages.Around`.
    steps : int array of shape (N,)
        The updates to go back from, table by table, first from the latest scans. Those of a scan
        are in the order of the tables, in which the processor reads memory ahead: backwards they
        would take almost twice as long.
    parts : int array of shape (G, 4)
        First step and end of the steps between two tables, and the indices of the table of the
        updates and of the table of those that they continue.
    """
    dropped, updates, sums = known
    past, count = len(updates), 0
    while past > 0 and updates[past - 1, STAMP] > since_ns:
        past -= 1
    latest, following = _updates_around(updates, dropped, past)
    needed = np.ones(len(updates), np.bool_)
    for index in range(past):
        needed[index] = latest[index]
    reportable = _find_reportable(threshold, needed, dropped, updates, sums)
    before, after = np.empty(past, np.int64), np.empty(past, np.int64)
    for index in range(len(updates)):
        needed[index] = needed[index] and reportable[index]
        if index < past and needed[index]:
            before[count], after[count] = index, following[index]
            count += 1
    steps = _find_steps(first, needed, dropped, updates)
    parts = _in_order(steps, dropped, updates, ends)
    return before[:count], after[:count], steps, parts


@compiled
def hypothesis_rows(
    chosen: Int1, known: Updates, ends: Int1
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the place of the update and the row of each hypothesis of chosen updates.

    They are sorted by table; the third array has their number in each, (A,). For `ends` see
    `plan_steps`.
    """
    dropped, updates, _ = known
    counts, begins = np.zeros(len(ends), np.int64), np.zeros(len(ends), np.int64)
    for update in chosen:
        table = count_below(ends, dropped + update + 1)
        counts[table] += updates[update, ROW + 1] - updates[update, ROW]
    for table in range(1, len(ends)):
        begins[table] = begins[table - 1] + counts[table - 1]
    position, rows = np.empty(counts.sum(), np.int64), np.empty(counts.sum(), np.int64)
    for index in range(len(chosen)):
        update = chosen[index]
        table = count_below(ends, dropped + update + 1)
        for row in range(updates[update, ROW], updates[update, ROW + 1]):
            position[begins[table]], rows[begins[table]] = index, row
            begins[table] += 1
    return position, rows, counts
