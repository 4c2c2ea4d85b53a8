"""The backward step, compiled: smoothed hypotheses, given the later ones that continue them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Bool1, Float2, Float3, Float4, Int1, Int2, compiled, inner
from .blocks import (
    SIZE,
    add_mean,
    add_spread,
    copy_gaussian,
    dot,
    log_determinant,
    square_distance,
)
from .vectors import add, sum_of, total_of, write_scaled

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0
# Replaces a log density that is not finite.
LEAST_DENSITY = -1e300


class Gaussians(NamedTuple):
    """Weights, means and covariances of N rows by motion mode, as of `Mixture`."""

    weight: Float3
    mean: Float3
    covariance: Float4


class Updates(NamedTuple):
    """U updates of single targets, oldest first, and the rows of each in the other tables."""

    before: Int1  # The update that each continues; -1 for none
    # First row and end, (U, 2), of the updated hypotheses, of the predicted ones, and of the edges
    # between them.
    row: Int2
    predicted: Int2
    edge: Int2


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
    factor: Float3
    gain: Float3
    base: Float3


class _Scratch(NamedTuple):
    """Working arrays for the smoothing of one update, allocated once."""

    fit: FloatArray  # (K,)
    mass: FloatArray  # (K,)
    joint: FloatArray  # (K, C)
    mean: FloatArray  # Mean of each pair's earlier Gaussian, (K, D)
    covariance: FloatArray  # Covariance of each pair's earlier Gaussian, (K, D, D)
    vector: FloatArray  # (D,)
    part: FloatArray  # Weight of each edge of an update, (E, R)


@inner
def _longest(updates: Updates) -> tuple[int, int]:
    """Return the largest number of predicted hypotheses and of edges of an update."""
    rows, edges = 0, 0
    for one in range(len(updates.before)):
        rows = max(rows, updates.predicted[one, 1] - updates.predicted[one, 0])
        edges = max(edges, updates.edge[one, 1] - updates.edge[one, 0])
    return rows, edges


@inner
def _scratch(pairs: int, modes: int, classes: int, edges: int) -> _Scratch:
    return _Scratch(
        np.empty(pairs),
        np.empty(pairs),
        np.empty((pairs, classes)),
        np.empty((pairs, SIZE)),
        np.empty((pairs, SIZE, SIZE)),
        np.empty(SIZE),
        np.empty((edges, modes)),
    )


@inner
def _clear(mean: FloatArray, covariance: FloatArray) -> None:
    """Write zeros; an assignment to parts of larger arrays would take longer."""
    for i in range(SIZE):
        mean[i] = 0.0
        for k in range(SIZE):
            covariance[i, k] = 0.0


@inner
def _write_predicted(
    updates: Updates, one: int, edges: Edges, later: Gaussians, part: FloatArray, ahead: Gaussians
) -> None:
    """Write the predicted hypotheses of an update, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a child that was merged from several parents is divided among
    them in proportion to their filtered weights. A hypothesis without children has no weight.
    """
    modes, classes = later.weight.shape[1:]
    first, count = updates.predicted[one, 0], updates.predicted[one, 1] - updates.predicted[one, 0]
    begin, end = updates.edge[one, 0], updates.edge[one, 1]
    ahead.weight[:count] = 0.0
    for edge in range(begin, end):
        to, child = edges.parent[edge] - first, edges.child[edge]
        for mode in range(modes):
            part[edge - begin, mode] = 0.0
            if not 0 <= to < count:
                continue
            if total_of(ahead.weight[to, mode]) == 0.0:
                _clear(ahead.mean[to, mode], ahead.covariance[to, mode])
            for class_id in range(classes):
                given = later.weight[child, mode, class_id] * edges.share[edge, mode, class_id]
                ahead.weight[to, mode, class_id] += given
                part[edge - begin, mode] += given
    for edge in range(begin, end):
        to, child = edges.parent[edge] - first, edges.child[edge]
        for mode in range(modes):
            if part[edge - begin, mode] > 0.0:
                part[edge - begin, mode] /= total_of(ahead.weight[to, mode])
                add_mean(part[edge - begin, mode], later.mean[child, mode], ahead.mean[to, mode])
    for edge in range(begin, end):
        to, child = edges.parent[edge] - first, edges.child[edge]
        for mode in range(modes):
            if part[edge - begin, mode] > 0.0:
                own, around = later.mean[child, mode], later.covariance[child, mode]
                at, spread = ahead.mean[to, mode], ahead.covariance[to, mode]
                add_spread(part[edge - begin, mode], own, around, at, spread)


@inner
def _write_fit(
    to: IntArray,
    place: IntArray,
    pairs: Pairs,
    later: Gaussians,
    at: int,
    apart: FloatArray,
    fit: FloatArray,
) -> None:
    """Write how well the mean of each later mode fits the predictions of its pairs, shape (K,).

    A normal density, divided by the largest of the pairs of the later mode; 1 for a single pair.
    """
    for mode in range(later.mean.shape[1]):
        largest, many, some = -np.inf, 0, total_of(later.weight[at, mode]) > 0.0
        for pair in range(len(to)):
            if to[pair] == mode:
                fit[pair] = 1.0 if some and place[pair] >= 0 else 0.0
                many += place[pair] >= 0
        if many < 2 or not some:
            continue
        for pair in range(len(to)):
            if to[pair] == mode and place[pair] >= 0:
                factor, predicted = pairs.factor[place[pair]], pairs.mean[place[pair]]
                square = square_distance(factor, later.mean[at, mode], predicted, apart)
                density = 0.5 * (log_determinant(factor) - square)
                fit[pair] = density if math.isfinite(density) else LEAST_DENSITY
                largest = max(largest, fit[pair])
        for pair in range(len(to)):
            if to[pair] == mode and place[pair] >= 0:
                fit[pair] = math.exp(max(fit[pair] - largest, LEAST_LOG_FIT))


@inner
def _given_later(joint: FloatArray, to: IntArray, later_weight: FloatArray) -> None:
    """Turn the joint weights of pairs (K, C) into those given the later modes' weights (R, C)."""
    for mode in range(len(later_weight)):
        for class_id in range(joint.shape[1]):
            predicted = 0.0
            for pair in range(len(to)):
                if to[pair] == mode:
                    predicted += joint[pair, class_id]
            some = predicted > 0.0
            back = later_weight[mode, class_id] / predicted if some else 0.0
            for pair in range(len(to)):
                if to[pair] == mode:
                    joint[pair, class_id] *= back


@inner
def _earlier(
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    later: tuple[FloatArray, FloatArray],
    half: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Write the earlier Gaussian of a pair, given its later one.

    `columns` are the mode's own mean, and the pair's mean, gain and base; see `Moves`.
    """
    own, predicted, gain, base = columns
    later_mean, later_covariance = later
    for i in range(SIZE):
        half[i] = later_mean[i] - predicted[i]
    for i in range(SIZE):
        mean[i] = own[i] + dot(gain[i], half)
    for i in range(SIZE):
        # Along the rows of the symmetric covariance the compiler computes several entries at once.
        for k in range(SIZE):
            half[k] = gain[i, 0] * later_covariance[0, k]
        for n in range(1, SIZE):
            for k in range(SIZE):
                half[k] += gain[i, n] * later_covariance[n, k]
        for k in range(i + 1):
            covariance[i, k] = covariance[k, i] = base[i, k] + dot(half, gain[k])


@inner
def _blend(
    share: float,
    own: FloatArray,
    own_spread: FloatArray,
    apart: FloatArray,
    mean: FloatArray,
    spread: FloatArray,
) -> None:
    """Add a share of a mode's own Gaussian, that of a target that dies, to the one given later."""
    between = share * (1.0 - share)
    for i in range(SIZE):
        apart[i] = own[i] - mean[i]
        mean[i] += share * apart[i]
    for i in range(SIZE):
        outer = between * apart[i]
        for k in range(SIZE):
            spread[i, k] += share * (own_spread[i, k] - spread[i, k]) + outer * apart[k]


@inner
def _write_row(
    of: IntArray,
    to: IntArray,
    own: Gaussians,
    at: int,
    predicted: Predicted,
    pairs: Pairs,
    row: int,
    later: Gaussians,
    part: int,
    scratch: _Scratch,
) -> None:
    """Write the joint weights and the earlier Gaussians of a row's pairs, given later modes."""
    fit, mass = scratch.fit, scratch.mass
    _write_fit(to, predicted.place[row], pairs, later, part, scratch.vector, fit)
    for pair in range(len(of)):
        prior = predicted.change[row, pair] * fit[pair]
        write_scaled(prior, own.weight[at, of[pair]], scratch.joint[pair])
    _given_later(scratch.joint, to, later.weight[part])
    for pair in range(len(of)):
        mass[pair] = total_of(scratch.joint[pair])
        if mass[pair] > 0.0:
            one = predicted.place[row, pair]
            columns = own.mean[at, of[pair]], pairs.mean[one], pairs.gain[one], pairs.base[one]
            given = later.mean[part, to[pair]], later.covariance[part, to[pair]]
            mean, covariance = scratch.mean[pair], scratch.covariance[pair]
            _earlier(columns, given, scratch.vector, mean, covariance)


@inner
def _add_pairs(of: IntArray, scratch: _Scratch, smoothed: Gaussians, at: int) -> float:
    """Write a row's smoothed modes, matched over their pairs; return their weight."""
    weight, mean, covariance = smoothed.weight[at], smoothed.mean[at], smoothed.covariance[at]
    mass = scratch.mass
    for pair in range(len(of)):
        if mass[pair] > 0.0:
            if total_of(weight[of[pair]]) == 0.0:
                _clear(mean[of[pair]], covariance[of[pair]])
            add(scratch.joint[pair], weight[of[pair]])
    for pair in range(len(of)):
        if mass[pair] > 0.0:
            share = mass[pair] / total_of(weight[of[pair]])
            add_mean(share, scratch.mean[pair], mean[of[pair]])
    for pair in range(len(of)):
        if mass[pair] > 0.0:
            mode = of[pair]
            share = mass[pair] / total_of(weight[mode])
            around = scratch.covariance[pair]
            add_spread(share, scratch.mean[pair], around, mean[mode], covariance[mode])
    return sum_of(weight)


@inner
def _add_deaths(
    death: float,
    survival: FloatArray,
    own: Gaussians,
    at: int,
    smoothed: Gaussians,
    apart: FloatArray,
) -> None:
    """Add to a row the targets of it that die; `death` is the factor on their weight."""
    for mode in range(len(survival)):
        died, left = death * (1.0 - survival[mode]), total_of(smoothed.weight[at, mode])
        gone = died * total_of(own.weight[at, mode])
        mean, covariance = smoothed.mean[at, mode], smoothed.covariance[at, mode]
        if not left > 0.0:
            copy_gaussian(own.mean[at, mode], own.covariance[at, mode], mean, covariance)
        elif gone > 0.0:
            share = gone / (left + gone)
            _blend(share, own.mean[at, mode], own.covariance[at, mode], apart, mean, covariance)
        for class_id in range(own.weight.shape[2]):
            smoothed.weight[at, mode, class_id] += died * own.weight[at, mode, class_id]


@compiled
def go_back(
    of: Int1,
    to: Int1,
    first: int,
    order: Int1,
    needed: Bool1,
    updates: Updates,
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
    order : int array of shape (U,)
        The updates of later scans first, and those of one scan in the order of the tables, in which
        memory is read ahead.
    needed : bool array of shape (U,)
        Whether each update is still of use; the others are left as they are.
    own, smoothed : Gaussians
        The filtered and the smoothed hypotheses; those of new updates are equal.
    """
    count, (most_rows, most_edges) = len(updates.before), _longest(updates)
    modes, classes = own.weight.shape[1:]
    scratch = _scratch(len(of), modes, classes, most_edges)
    ahead = Gaussians(
        np.empty((most_rows, modes, classes)),
        np.empty((most_rows, modes, SIZE)),
        np.empty((most_rows, modes, SIZE, SIZE)),
    )
    changed = np.arange(count) >= first
    for place in range(count):
        one = order[place]
        before = updates.before[one]
        if before < 0 or not changed[one] or not needed[before]:
            continue
        changed[before] = True
        begin, alive, dead = updates.row[before, 0], 0.0, 1.0
        first_row, end_row = updates.predicted[one, 0], updates.predicted[one, 1]
        kept = updates.edge[one, 0] < updates.edge[one, 1]
        if kept:
            _write_predicted(updates, one, edges, smoothed, scratch.part, ahead)
        for row in range(first_row, end_row):
            part, at = row - first_row, begin + row - first_row
            smoothed.weight[at] = 0.0
            for mode in range(modes):
                dead -= predicted.survival[row, mode] * total_of(own.weight[at, mode])
            if kept and sum_of(ahead.weight[part]) > 0.0:
                _write_row(of, to, own, at, predicted, pairs, row, ahead, part, scratch)
                alive += _add_pairs(of, scratch, smoothed, at)
        death = (1.0 - min(alive, 1.0)) / dead if dead > 0.0 else 0.0
        for row in range(first_row, end_row):
            at, survival = begin + row - first_row, predicted.survival[row]
            _add_deaths(death, survival, own, at, smoothed, scratch.vector)
