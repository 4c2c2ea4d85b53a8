"""The backward step, compiled: smoothed hypotheses, given the later ones that continue them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...compilation import (
    Bool1,
    Float1,
    Float2,
    Float3,
    Float4,
    Int1,
    Int2,
    in_place,
    inner,
)
from .blocks import (
    SIZE,
    add_mean,
    add_spread,
    check_matrices,
    check_vectors,
    copy_gaussian,
    difference,
    dot,
    log_determinant,
    square_distance,
    times,
)
from .vectors import add, total_of

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0
# Replaces a log density that is not finite.
LEAST_DENSITY = -1e300


class Gaussians(NamedTuple):
    """Weights, means and covariances of N rows by motion mode, as in `Mixture`."""

    weight: Float3
    mean: Float3
    covariance: Float4


# Columns of the U updates of single targets, oldest first, (U, COLUMNS): the stamp, the label, and
# the number of the update that each continues, -1 for none. Then the first row and the end, in the
# other tables, of its updated hypotheses, of the predicted ones, and of the edges between them. The
# others are the first rows of its scan, from which the rows that tables refer to are counted.
STAMP, LABEL, BEFORE, ROW, PREDICTED, EDGE = 0, 1, 2, 3, 5, 7
FIRST_ROW, FIRST_PREDICTED, FIRST_PAIR, FIRST_FACTOR, COLUMNS = 9, 10, 11, 12, 13


class Edges(NamedTuple):
    """The edges from updated to predicted hypotheses; see `reduction.Ancestry`."""

    child: Int1
    parent: Int1
    share: Float3


class Predicted(NamedTuple):
    """The predicted hypotheses; see `prediction.Moves`."""

    change: Float2
    survival: Float2
    place: Int2


class Pairs(NamedTuple):
    """The predictions from one motion mode to another; see `prediction.Moves`."""

    mean: Float2
    factored: Int1
    gain: Float3
    base: Float3
    factor: Float3  # A table with rows of its own


class _Scratch(NamedTuple):
    """Working arrays, allocated once: which updates have changed, (U,), and those of one update."""

    changed: Bool1
    active: Int1  # The pairs of a row that have weight, (K,); the next arrays have their order
    fit: Float1  # (K,)
    mass: Float1  # (K,)
    joint: Float2  # (K, C)
    mean: Float2  # Mean of each pair's earlier Gaussian, (K, D)
    covariance: Float3  # Covariance of each pair's earlier Gaussian, (K, D, D)
    vector: Float1  # (D,)
    part: Float2  # Weight of each edge of an update, (E, R)
    ahead: Float2  # Weight of each predicted Gaussian of an update, (H, R)
    predicted: Float2  # Weight of each later mode and class, as predicted, (R, C)
    own: Float1  # Weight of each smoothed Gaussian of a row, (R,)


@inner
def _clear(mean: FloatArray, covariance: FloatArray) -> None:
    """Write zeros; an assignment to parts of larger arrays would take longer."""
    for i in range(SIZE):
        mean[i] = 0.0
        for k in range(SIZE):
            covariance[i, k] = 0.0


@inner
def _write_predicted(
    update: IntArray, edges: Edges, later: Gaussians, scratch: _Scratch, ahead: Gaussians
) -> None:
    """Write the predicted hypotheses of an update, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a child that was merged from several parents is divided among
    them in proportion to their filtered weights. A hypothesis without children has no weight.
    """
    modes, classes = later.weight.shape[1:]
    first, count = update[FIRST_ROW], update[PREDICTED + 1] - update[PREDICTED]
    offset = update[FIRST_PREDICTED] - update[PREDICTED]
    begin, end = update[EDGE], update[EDGE + 1]
    part, whole = scratch.part, scratch.ahead
    for to in range(count):
        for mode in range(modes):
            for class_id in range(classes):
                ahead.weight[to, mode, class_id] = 0.0
    for edge in range(begin, end):
        to, child = edges.parent[edge] + offset, edges.child[edge] + first
        for mode in range(modes):
            part[edge - begin, mode] = 0.0
            for class_id in range(classes if 0 <= to < count else 0):
                given = later.weight[child, mode, class_id] * edges.share[edge, mode, class_id]
                ahead.weight[to, mode, class_id] += given
                part[edge - begin, mode] += given
    for to in range(count):
        for mode in range(modes):
            whole[to, mode] = total_of(ahead.weight[to, mode])
            if whole[to, mode] > 0.0:
                _clear(ahead.mean[to, mode], ahead.covariance[to, mode])
    for edge in range(begin, end):
        to, child = edges.parent[edge] + offset, edges.child[edge] + first
        for mode in range(modes):
            if part[edge - begin, mode] > 0.0:
                part[edge - begin, mode] /= whole[to, mode]
                add_mean(part[edge - begin, mode], later.mean[child, mode], ahead.mean[to, mode])
    for edge in range(begin, end):
        to, child = edges.parent[edge] + offset, edges.child[edge] + first
        for mode in range(modes):
            if part[edge - begin, mode] > 0.0:
                own, around = later.mean[child, mode], later.covariance[child, mode]
                at, spread = ahead.mean[to, mode], ahead.covariance[to, mode]
                add_spread(part[edge - begin, mode], own, around, at, spread)


@inner
def _write_fit(
    active: IntArray,
    of: IntArray,
    to: IntArray,
    place: IntArray,
    pairs: Pairs,
    update: IntArray,
    later: FloatArray,
    scratch: _Scratch,
) -> None:
    """Write how well the mean of each later mode, (R, D), fits the predictions of active pairs.

    The fit is a normal density, divided by the largest of all pairs with the same later mode; that
    of a single pair is 1.
    """
    fit, several = scratch.fit, False
    for one in range(len(active)):
        fit[one] = 1.0
        several = several or of[active[one]] != of[active[0]]
    for mode in range(len(later) if several else 0):
        largest, many = -np.inf, 0
        for one in range(len(active)):
            many += to[active[one]] == mode
        if many < 2:
            continue
        for one in range(len(active)):
            if to[active[one]] == mode:
                at = update[FIRST_PAIR] + place[active[one]]
                factor = pairs.factor[update[FIRST_FACTOR] + pairs.factored[at]]
                predicted = pairs.mean[at]
                square = square_distance(factor, later[mode], predicted, scratch.vector)
                density = 0.5 * (log_determinant(factor) - square)
                fit[one] = density if math.isfinite(density) else LEAST_DENSITY
                largest = max(largest, fit[one])
        for one in range(len(active)):
            if to[active[one]] == mode:
                fit[one] = math.exp(max(fit[one] - largest, LEAST_LOG_FIT))


@inner
def _earlier(
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    later: tuple[FloatArray, FloatArray],
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Write the earlier Gaussian of a pair, given its later one.

    `columns` are the mode's own mean, and the pair's mean, gain and base; see `Moves`.
    """
    own, predicted, gain, base = columns
    at, around = later
    apart = difference(at, predicted)
    for i in range(SIZE):
        mean[i] = own[i] + dot(gain[i], apart)
    for i in range(SIZE):
        row = times(gain[i], around)
        for k in range(i + 1):
            covariance[i, k] = covariance[k, i] = base[i, k] + dot(row, gain[k])


@inner
def _blend(
    share: float,
    own: FloatArray,
    own_spread: FloatArray,
    mean: FloatArray,
    spread: FloatArray,
) -> None:
    """Blend the Gaussian of a surviving target, in place, with that of a dying one, `own`.

    `share` is the weight of the latter.
    """
    between, (x, vx, y, vy, omega) = share * (1.0 - share), difference(own, mean)
    for i in range(SIZE):
        before, total, outer = own_spread[i], spread[i], between * (own[i] - mean[i])
        # For the order see `add_spread`.
        first = total[0] + (share * (before[0] - total[0]) + outer * x)
        second = total[1] + (share * (before[1] - total[1]) + outer * vx)
        third = total[2] + (share * (before[2] - total[2]) + outer * y)
        fourth = total[3] + (share * (before[3] - total[3]) + outer * vy)
        total[4] += share * (before[4] - total[4]) + outer * omega
        total[0], total[1], total[2], total[3] = first, second, third, fourth
    for i in range(SIZE):
        mean[i] += share * (own[i] - mean[i])


@inner
def _active(
    of: IntArray,
    to: IntArray,
    prior: tuple[FloatArray, FloatArray],
    place: IntArray,
    pairs: Pairs,
    update: IntArray,
    later: Gaussians,
    part: int,
    scratch: _Scratch,
) -> IntArray:
    """Return the pairs of a row that have weight, and write their joint weights given later modes.

    `prior` are the row's weights, (R, C), and the probabilities of its pairs, (K,).
    """
    joint, predicted, count, (own, change) = scratch.joint, scratch.predicted, 0, prior
    for pair in range(len(of)):
        if place[pair] >= 0 and scratch.ahead[part, to[pair]] > 0.0:
            scratch.active[count] = pair
            count += 1
    active = scratch.active[:count]
    _write_fit(active, of, to, place, pairs, update, later.mean[part], scratch)
    for mode in range(len(predicted)):
        for class_id in range(predicted.shape[1]):
            predicted[mode, class_id] = 0.0
    for one in range(count):
        pair = active[one]
        factor = change[pair] * scratch.fit[one]
        for class_id in range(predicted.shape[1]):
            joint[one, class_id] = factor * own[of[pair], class_id]
            predicted[to[pair], class_id] += joint[one, class_id]
    for one in range(count):
        mode, scratch.mass[one] = to[active[one]], 0.0
        for class_id in range(predicted.shape[1]):
            if joint[one, class_id] > 0.0:
                back = later.weight[part, mode, class_id] / predicted[mode, class_id]
                joint[one, class_id] *= back
                scratch.mass[one] += joint[one, class_id]
    return active


@inner
def _write_row(
    of: IntArray,
    to: IntArray,
    own: Gaussians,
    at: int,
    predicted: Predicted,
    pairs: Pairs,
    update: IntArray,
    row: int,
    later: Gaussians,
    part: int,
    scratch: _Scratch,
    smoothed: Gaussians,
) -> float:
    """Write a row's smoothed modes, matched over its pairs; return their weight."""
    mass, total, place = scratch.mass, 0.0, predicted.place[row]
    prior = own.weight[at], predicted.change[row]
    active = _active(of, to, prior, place, pairs, update, later, part, scratch)
    weight, mean, covariance = smoothed.weight[at], smoothed.mean[at], smoothed.covariance[at]
    for one in range(len(active)):
        if mass[one] > 0.0:
            pair, before = update[FIRST_PAIR] + place[active[one]], of[active[one]]
            columns = own.mean[at, before], pairs.mean[pair], pairs.gain[pair], pairs.base[pair]
            after = to[active[one]]
            given = later.mean[part, after], later.covariance[part, after]
            _earlier(columns, given, scratch.mean[one], scratch.covariance[one])
            add(scratch.joint[one], weight[before])
    for mode in range(len(scratch.own)):
        scratch.own[mode] = total_of(weight[mode])
        total += scratch.own[mode]
        if scratch.own[mode] > 0.0:
            _clear(mean[mode], covariance[mode])
    for one in range(len(active)):
        if mass[one] > 0.0:
            mode = of[active[one]]
            mass[one] /= scratch.own[mode]
            add_mean(mass[one], scratch.mean[one], mean[mode])
    for one in range(len(active)):
        if mass[one] > 0.0:
            mode, around = of[active[one]], scratch.covariance[one]
            add_spread(mass[one], scratch.mean[one], around, mean[mode], covariance[mode])
    return total


@inner
def _add_deaths(
    death: float, survival: FloatArray, own: Gaussians, at: int, smoothed: Gaussians
) -> None:
    """Add the share of a row that dies before the later scan; `death` is the factor on its weight.

    A Gaussian that has no weight is left as it is.
    """
    for mode in range(len(survival)):
        died = death * (1.0 - survival[mode])
        gone, left = died * total_of(own.weight[at, mode]), total_of(smoothed.weight[at, mode])
        if not gone > 0.0:
            continue
        mean, covariance = smoothed.mean[at, mode], smoothed.covariance[at, mode]
        if left > 0.0:
            share = gone / (left + gone)
            _blend(share, own.mean[at, mode], own.covariance[at, mode], mean, covariance)
        else:
            copy_gaussian(own.mean[at, mode], own.covariance[at, mode], mean, covariance)
        for class_id in range(own.weight.shape[2]):
            smoothed.weight[at, mode, class_id] += died * own.weight[at, mode, class_id]


@in_place
def _go_back(
    of: Int1,
    to: Int1,
    order: Int1,
    dropped: int,
    needed: Bool1,
    updates: Int2,
    edges: Edges,
    predicted: Predicted,
    pairs: Pairs,
    own: Gaussians,
    smoothed: Gaussians,
    ahead: Gaussians,
    scratch: _Scratch,
) -> None:
    """Smooth the updates that changed ones continue, and mark them as changed."""
    modes, classes = own.weight.shape[1:]
    for gaussians in (own, smoothed, ahead):
        check_vectors(gaussians.mean)
        check_matrices(gaussians.covariance)
    check_vectors(pairs.mean)
    for matrices in (pairs.gain, pairs.base, pairs.factor, scratch.covariance):
        check_matrices(matrices)
    for index in order:
        update, before = updates[index], updates[index, BEFORE] - dropped
        if before < 0 or not scratch.changed[index] or not needed[before]:
            continue
        scratch.changed[before] = True
        begin, alive, dead = updates[before, ROW], 0.0, 1.0
        first_row, end_row = update[PREDICTED], update[PREDICTED + 1]
        kept = update[EDGE] < update[EDGE + 1]
        if kept:
            _write_predicted(update, edges, smoothed, scratch, ahead)
        for row in range(first_row, end_row):
            part, at = row - first_row, begin + row - first_row
            for mode in range(modes):
                dead -= predicted.survival[row, mode] * total_of(own.weight[at, mode])
                for class_id in range(classes):
                    smoothed.weight[at, mode, class_id] = 0.0
            if kept and total_of(scratch.ahead[part]) > 0.0:
                alive += _write_row(
                    of, to, own, at, predicted, pairs, update, row, ahead, part, scratch, smoothed
                )
        death = (1.0 - min(alive, 1.0)) / dead if dead > 0.0 else 0.0
        for row in range(first_row, end_row):
            at, survival = begin + row - first_row, predicted.survival[row]
            _add_deaths(death, survival, own, at, smoothed)


def go_back(
    of: IntArray,
    to: IntArray,
    first: int,
    dropped: int,
    needed: BoolArray,
    updates: IntArray,
    edges: Edges,
    predicted: Predicted,
    pairs: Pairs,
    own: Gaussians,
    smoothed: Gaussians,
) -> None:
    """Smooth the updates that those from `first` on continue, directly or not.

    Parameters
    ----------
    of, to : int arrays of shape (K,)
        The pairs of motion modes of `prediction.Moves`.
    first : int
        The first new update.
    dropped : int
        Number of the first update.
    needed : bool array of shape (U,)
        Whether each update is still of use; the others are left as they are.
    own, smoothed : Gaussians
        The filtered and the smoothed hypotheses; those of new updates are equal.
    """
    (modes, classes), count = own.weight.shape[1:], len(of)
    rows = (updates[:, PREDICTED + 1] - updates[:, PREDICTED]).max()
    most_edges = (updates[:, EDGE + 1] - updates[:, EDGE]).max()
    ahead = Gaussians(
        np.empty((rows, modes, classes)),
        np.empty((rows, modes, SIZE)),
        np.empty((rows, modes, SIZE, SIZE)),
    )
    scratch = _Scratch(
        np.arange(len(updates)) >= first,
        np.empty(count, np.int64),
        np.empty(count),
        np.empty(count),
        np.empty((count, classes)),
        np.empty((count, SIZE)),
        np.empty((count, SIZE, SIZE)),
        np.empty(SIZE),
        np.empty((most_edges, modes)),
        np.empty((rows, modes)),
        np.empty((modes, classes)),
        np.empty(modes),
    )
    tables = edges, predicted, pairs, own, smoothed
    # The later scans are first, but the updates of a scan are in the order of the tables, in which
    # the processor reads memory ahead: backwards they would take almost twice as long.
    order = (-updates[:, STAMP]).argsort(kind="stable")
    _go_back(of, to, order, dropped, needed, updates, *tables, ahead, scratch)
