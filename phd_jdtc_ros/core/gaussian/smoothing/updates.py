"""The updates of single targets: rows of one table, each with the rows of others that it has."""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...bisection import count_below
from ...compilation import Bool1, Float2, Float3, Int1, Int2, compiled, inner
from ..algebra.vectors import total_of

# Columns of the U updates of single targets, oldest first, (U, COLUMNS): the stamp, the label, and
# the number of the update that each continues, -1 for none. Then the first row and the end, among
# those of the scan, of its updated hypotheses, of the predicted ones, and of the edges between.
STAMP, LABEL, BEFORE, ROW, PREDICTED, EDGE, COLUMNS = 0, 1, 2, 3, 5, 7, 9
# Columns of the sums of an update's hypotheses, (U, SUMS): the filtered existence probability, and
# the probabilities that the target died since the update before, and that it does not exist now.
EXISTENCE, DIED, DEAD, SUMS = 0, 1, 2, 3
# Bound on the rounding of an existence probability.
ROUNDING = 1e-9


@inner
def _extend_rows(update: IntArray, column: int, row: int) -> None:
    """Extend an update's rows in another table by the next one."""
    if update[column + 1] == 0:
        update[column] = row
    update[column + 1] = row + 1


@compiled
def make_updates(
    stamp_ns: int,
    label: Int1,
    row_update: Int1,
    continued: Int1,
    child: Int1,
    dropped: int,
    existing: Int2,
) -> IntArray:
    """Return the updates of a scan: those of its targets, and of those that it dropped.

    Parameters
    ----------
    label : int array of shape (U,)
        Label of each update's target, ascending.
    row_update : int array of shape (H,)
        Update of each updated hypothesis.
    continued : int array of shape (E,)
        Update of each hypothesis that the scan continues; -1 if it has left the window.
    child : int array
        Updated hypothesis of each edge.
    dropped, existing : int, and int array of shape (V, COLUMNS)
        The number of the first earlier update, and all of them.
    """
    updates = np.zeros((len(label), COLUMNS), np.int64)
    for index in range(len(label)):
        updates[index, STAMP], updates[index, LABEL] = stamp_ns, label[index]
        updates[index, BEFORE] = -1
    for number in range(len(existing)):
        index = count_below(label, existing[number, LABEL])
        if index < len(label) and label[index] == existing[number, LABEL]:
            updates[index, BEFORE] = dropped + number  # the last one stays
    for row in range(len(row_update)):
        _extend_rows(updates[row_update[row]], ROW, row)
    for row in range(len(continued)):
        if continued[row] >= 0:
            _extend_rows(updates[continued[row]], PREDICTED, row)
    for edge in range(len(child)):
        _extend_rows(updates[row_update[child[edge]]], EDGE, edge)
    return updates


@compiled
def sum_hypotheses(updates: Int2, weight: Float3, before: Float3, survival: Float2) -> FloatArray:
    """Return the sums of a scan's updates, (U, SUMS).

    `weight` and `before` are those of the updated hypotheses, and of those that the scan continues.
    """
    sums = np.zeros((len(updates), SUMS))
    for index in range(len(updates)):
        own = sums[index]
        own[DEAD] = 1.0
        for row in range(updates[index, ROW], updates[index, ROW + 1]):
            for mode in range(weight.shape[1]):
                own[EXISTENCE] += total_of(weight[row, mode])
        for row in range(updates[index, PREDICTED], updates[index, PREDICTED + 1]):
            for mode in range(before.shape[1]):
                row_weight = total_of(before[row, mode])
                own[DIED] += (1.0 - survival[row, mode]) * row_weight
                own[DEAD] -= survival[row, mode] * row_weight
    return sums


@compiled
def updates_around(updates: Int2, dropped: int, past: int) -> tuple[BoolArray, IntArray]:
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
def find_reportable(
    threshold: float, needed: Bool1, dropped: int, updates: Int2, sums: Float2
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
        if existence[index] < 0.0:  # it is the target's last one
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


@compiled
def find_steps(first: int, needed: Bool1, dropped: int, updates: Int2) -> IntArray:
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


@compiled
def hypothesis_rows(chosen: Int1, updates: Int2) -> tuple[IntArray, IntArray]:
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
