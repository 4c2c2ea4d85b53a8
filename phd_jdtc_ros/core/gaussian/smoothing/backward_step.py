"""The backward step, compiled: smoothed hypotheses, given the later ones that continue them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import (
    SIZE,
    BySize,
    Float1,
    Float2,
    Float3,
    Int1,
    Int2,
    Writeable,
    compiled,
    in_place,
    inner,
)
from ...state_space import VZ, Z
from ..algebra.blocks import (
    add,
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
    total_of,
)
from ..dynamics import ModePairs
from ..mixture import Gaussians
from .updates import BEFORE, EDGE, PREDICTED, ROW, Updates

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0
# Replaces a log density that is not finite.
LEAST_DENSITY = -1e300


class Links(NamedTuple):
    """The links of updated hypotheses to earlier ones; see `Ancestry` and `Moves`."""

    child: Int1
    parent: Int1
    share: Float3
    change: Float2
    survival: Float2
    place: Int2
    mean: Float2
    factored: Int1
    gain: Float3
    base: Float3
    factor: Float3


class _Scratch(NamedTuple):
    """Working arrays for the step from one update, allocated once."""

    successors: Gaussians  # The predicted hypotheses of an update, given later scans, (H, R)
    active: Int1  # The pairs of a row that have weight, (K,); the next arrays have their order
    fit: Float1  # (K,)
    mass: Float1  # (K,)
    joint: Float2  # (K, C)
    mean: Float2  # Mean of each pair's earlier Gaussian, (K, D)
    covariance: Float3  # Covariance of each pair's earlier Gaussian, (K, D, D)
    vector: Float1  # (D,)
    edge_weight: Float2  # Weight of each edge of an update, (E, R)
    successor_weight: Float2  # Weight of each predicted Gaussian of an update, (H, R)
    predicted_weight: Float2  # Weight of each later mode and class, as predicted, (R, C)
    smoothed_weight: Float1  # Weight of each smoothed Gaussian of a row, (R,)


@inner
def _clear(mean: FloatArray, covariance: FloatArray) -> None:
    """Write zeros; an assignment to parts of larger arrays would take longer."""
    for i in range(SIZE):
        mean[i] = 0.0
        for k in range(SIZE):
            covariance[i, k] = 0.0


@inner
def _write_successors(
    update: IntArray, links: Links, smoothed: Gaussians, scratch: _Scratch
) -> None:
    """Write the predicted hypotheses of an update, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a child that was merged from several parents is divided among
    them in proportion to their filtered weights. A hypothesis without children has no weight.
    """
    modes, classes = smoothed.weight.shape[1:]
    first, count = update[PREDICTED], update[PREDICTED + 1] - update[PREDICTED]
    begin, end, successors = update[EDGE], update[EDGE + 1], scratch.successors
    edge_weight, gaussian_weight = scratch.edge_weight, scratch.successor_weight
    for parent in range(count):
        for mode in range(modes):
            for class_id in range(classes):
                successors.weight[parent, mode, class_id] = 0.0
    for edge in range(begin, end):
        parent, child = links.parent[edge] - first, links.child[edge]
        for mode in range(modes):
            edge_weight[edge - begin, mode] = 0.0
            for class_id in range(classes if 0 <= parent < count else 0):
                weight = smoothed.weight[child, mode, class_id] * links.share[edge, mode, class_id]
                successors.weight[parent, mode, class_id] += weight
                edge_weight[edge - begin, mode] += weight
    for parent in range(count):
        for mode in range(modes):
            gaussian_weight[parent, mode] = total_of(successors.weight[parent, mode])
            if gaussian_weight[parent, mode] > 0.0:
                _clear(successors.mean[parent, mode], successors.covariance[parent, mode])
    for edge in range(begin, end):
        parent, child = links.parent[edge] - first, links.child[edge]
        for mode in range(modes):
            if edge_weight[edge - begin, mode] > 0.0:
                edge_weight[edge - begin, mode] /= gaussian_weight[parent, mode]
                add_mean(
                    edge_weight[edge - begin, mode],
                    smoothed.mean[child, mode],
                    successors.mean[parent, mode],
                )
    for edge in range(begin, end):
        parent, child = links.parent[edge] - first, links.child[edge]
        for mode in range(modes):
            if edge_weight[edge - begin, mode] > 0.0:
                mean, covariance = smoothed.mean[child, mode], smoothed.covariance[child, mode]
                centre, spread = successors.mean[parent, mode], successors.covariance[parent, mode]
                add_spread(edge_weight[edge - begin, mode], mean, covariance, centre, spread)


@inner
def _write_fit(
    active: IntArray,
    pairs: ModePairs,
    pair_row: IntArray,
    links: Links,
    later_mean: FloatArray,
    scratch: _Scratch,
) -> None:
    """Write how well the mean of each later mode, (R, D), fits the predictions of active links.

    The fit is a normal density, divided by the largest of all pairs with the same later mode; that
    of a single pair is 1.
    """
    (from_mode, to_mode), fit, modes_differ = pairs, scratch.fit, False
    for index in range(len(active)):
        fit[index] = 1.0
        modes_differ = modes_differ or from_mode[active[index]] != from_mode[active[0]]
    for mode in range(len(later_mean) if modes_differ else 0):
        largest, count = -np.inf, 0
        for index in range(len(active)):
            count += to_mode[active[index]] == mode
        if count < 2:
            continue
        for index in range(len(active)):
            if to_mode[active[index]] == mode:
                row = pair_row[active[index]]
                factor, predicted = links.factor[links.factored[row]], links.mean[row]
                square = square_distance(factor, later_mean[mode], predicted, scratch.vector)
                density = 0.5 * (log_determinant(factor) - square)
                fit[index] = density if math.isfinite(density) else LEAST_DENSITY
                largest = max(largest, fit[index])
        for index in range(len(active)):
            if to_mode[active[index]] == mode:
                fit[index] = math.exp(max(fit[index] - largest, LEAST_LOG_FIT))


@inner
def _write_earlier(
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    later: tuple[FloatArray, FloatArray],
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Write the earlier Gaussian of a pair, given its later one.

    `columns` are the mode's own mean, and the pair's mean, gain and base; see `Moves`.
    """
    filtered_mean, predicted_mean, gain, base = columns
    later_mean, later_covariance = later
    deviation = difference(later_mean, predicted_mean)
    for i in range(SIZE):
        mean[i] = filtered_mean[i] + dot(gain[i], deviation)
    for i in range(SIZE):
        row = times(gain[i], later_covariance)
        for k in range(i + 1):
            covariance[i, k] = covariance[k, i] = base[i, k] + dot(row, gain[k])


@inner
def _blend_with_dying(
    share: float,
    dying_mean: FloatArray,
    dying_covariance: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Blend the Gaussian of a surviving target, in place, with that of a dying one.

    `share` is the weight of the latter.
    """
    x, vx, y, vy, omega, z, vz = difference(dying_mean, mean)
    for i in range(SIZE):
        dying, row = dying_covariance[i], covariance[i]
        outer = share * (1.0 - share) * (dying_mean[i] - mean[i])
        # For the order see `add_spread`.
        first = row[0] + (share * (dying[0] - row[0]) + outer * x)
        second = row[1] + (share * (dying[1] - row[1]) + outer * vx)
        third = row[2] + (share * (dying[2] - row[2]) + outer * y)
        fourth = row[3] + (share * (dying[3] - row[3]) + outer * vy)
        fifth = row[4] + (share * (dying[4] - row[4]) + outer * omega)
        if SIZE > Z:
            row[Z] += share * (dying[Z] - row[Z]) + outer * z
            row[VZ] += share * (dying[VZ] - row[VZ]) + outer * vz
        row[0], row[1], row[2], row[3], row[4] = first, second, third, fourth, fifth
    for i in range(SIZE):
        mean[i] += share * (dying_mean[i] - mean[i])


@inner
def _weigh_pairs(
    pairs: ModePairs,
    prior: tuple[FloatArray, FloatArray],
    pair_row: IntArray,
    links: Links,
    offset: int,
    scratch: _Scratch,
) -> IntArray:
    """Return the pairs of a row that have weight, and write their joint weights given later modes.

    `prior` are the row's weights, (R, C), and the probabilities of its pairs, (K,).
    """
    joint, predicted_weight = scratch.joint, scratch.predicted_weight
    successors, (from_mode, to_mode) = scratch.successors, pairs
    (weight, change), count = prior, 0
    for pair in range(len(from_mode)):
        if pair_row[pair] >= 0 and scratch.successor_weight[offset, to_mode[pair]] > 0.0:
            scratch.active[count] = pair
            count += 1
    active = scratch.active[:count]
    _write_fit(active, pairs, pair_row, links, successors.mean[offset], scratch)
    for mode in range(len(predicted_weight)):
        for class_id in range(predicted_weight.shape[1]):
            predicted_weight[mode, class_id] = 0.0
    for index in range(count):
        pair = active[index]
        factor = change[pair] * scratch.fit[index]
        for class_id in range(predicted_weight.shape[1]):
            joint[index, class_id] = factor * weight[from_mode[pair], class_id]
            predicted_weight[to_mode[pair], class_id] += joint[index, class_id]
    for index in range(count):
        mode, scratch.mass[index] = to_mode[active[index]], 0.0
        for class_id in range(predicted_weight.shape[1]):
            if joint[index, class_id] > 0.0:
                ratio = successors.weight[offset, mode, class_id] / predicted_weight[mode, class_id]
                joint[index, class_id] *= ratio
                scratch.mass[index] += joint[index, class_id]
    return active


@inner
def _write_row(
    pairs: ModePairs,
    filtered: Gaussians,
    hypothesis: int,
    links: Links,
    row: int,
    offset: int,
    scratch: _Scratch,
    smoothed: Gaussians,
) -> float:
    """Write a row's smoothed modes, matched over its pairs; return their weight."""
    mass, total, pair_row = scratch.mass, 0.0, links.place[row]
    successors, (from_mode, to_mode) = scratch.successors, pairs
    prior = filtered.weight[hypothesis], links.change[row]
    active = _weigh_pairs(pairs, prior, pair_row, links, offset, scratch)
    weight, mean = smoothed.weight[hypothesis], smoothed.mean[hypothesis]
    covariance = smoothed.covariance[hypothesis]
    for index in range(len(active)):
        if mass[index] > 0.0:
            pair = pair_row[active[index]]
            earlier_mode, later_mode = from_mode[active[index]], to_mode[active[index]]
            columns = (
                filtered.mean[hypothesis, earlier_mode],
                links.mean[pair],
                links.gain[pair],
                links.base[pair],
            )
            later_gaussian = (
                successors.mean[offset, later_mode],
                successors.covariance[offset, later_mode],
            )
            _write_earlier(columns, later_gaussian, scratch.mean[index], scratch.covariance[index])
            add(scratch.joint[index], weight[earlier_mode])
    for mode in range(len(scratch.smoothed_weight)):
        scratch.smoothed_weight[mode] = total_of(weight[mode])
        total += scratch.smoothed_weight[mode]
        if scratch.smoothed_weight[mode] > 0.0:
            _clear(mean[mode], covariance[mode])
    for index in range(len(active)):
        if mass[index] > 0.0:
            mode = from_mode[active[index]]
            mass[index] /= scratch.smoothed_weight[mode]
            add_mean(mass[index], scratch.mean[index], mean[mode])
    for index in range(len(active)):
        if mass[index] > 0.0:
            mode, pair_covariance = from_mode[active[index]], scratch.covariance[index]
            add_spread(
                mass[index], scratch.mean[index], pair_covariance, mean[mode], covariance[mode]
            )
    return total


@inner
def _add_deaths(
    death: float, survival: FloatArray, filtered: Gaussians, row: int, smoothed: Gaussians
) -> None:
    """Add the share of a row that dies before the later scan; `death` is the factor on its weight.

    A Gaussian that has no weight is left as it is.
    """
    for mode in range(len(survival)):
        factor = death * (1.0 - survival[mode])
        dying = factor * total_of(filtered.weight[row, mode])
        surviving = total_of(smoothed.weight[row, mode])
        if not dying > 0.0:
            continue
        mean, covariance = smoothed.mean[row, mode], smoothed.covariance[row, mode]
        if surviving > 0.0:
            share = dying / (surviving + dying)
            _blend_with_dying(
                share, filtered.mean[row, mode], filtered.covariance[row, mode], mean, covariance
            )
        else:
            copy_gaussian(
                filtered.mean[row, mode], filtered.covariance[row, mode], mean, covariance
            )
        for class_id in range(filtered.weight.shape[2]):
            smoothed.weight[row, mode, class_id] += factor * filtered.weight[row, mode, class_id]


@in_place
def _go_back(
    pairs: ModePairs,
    steps: Int1,
    updates: Updates,
    links: Links,
    later: Gaussians,
    filtered: Gaussians,
    smoothed: Writeable[Gaussians],
    scratch: Writeable[_Scratch],
) -> None:
    """Smooth the updates that those in `steps` continue; see `go_back`."""
    rows, dropped = updates.rows, updates.dropped
    modes, classes = links.share.shape[1:]
    for gaussians in (later, filtered):
        check_vectors(gaussians.mean)
        check_matrices(gaussians.covariance)
    for gaussians in (smoothed, scratch.successors):
        check_vectors(gaussians.mean)
        check_matrices(gaussians.covariance)
    check_vectors(links.mean)
    for matrices in (links.gain, links.base, links.factor):
        check_matrices(matrices)
    check_matrices(scratch.covariance)
    for index in steps:
        update, begin = rows[index], rows[rows[index, BEFORE] - dropped, ROW]
        alive, dead, first_row, end_row = 0.0, 1.0, update[PREDICTED], update[PREDICTED + 1]
        has_children = update[EDGE] < update[EDGE + 1]
        if has_children:
            _write_successors(update, links, later, scratch)
        for row in range(first_row, end_row):
            offset, hypothesis = row - first_row, begin + row - first_row
            for mode in range(modes):
                dead -= links.survival[row, mode] * total_of(filtered.weight[hypothesis, mode])
                for class_id in range(classes):
                    smoothed.weight[hypothesis, mode, class_id] = 0.0
            if has_children and total_of(scratch.successor_weight[offset]) > 0.0:
                alive += _write_row(
                    pairs, filtered, hypothesis, links, row, offset, scratch, smoothed
                )
        death = (1.0 - min(alive, 1.0)) / dead if dead > 0.0 else 0.0
        for row in range(first_row, end_row):
            survival, hypothesis = links.survival[row], begin + row - first_row
            _add_deaths(death, survival, filtered, hypothesis, smoothed)


@BySize
@compiled
def go_back(
    pairs: ModePairs,
    steps: Int1,
    updates: Updates,
    links: Links,
    later: Gaussians,
    filtered: Gaussians,
    smoothed: Writeable[Gaussians],
) -> None:
    """Smooth the updates that others continue, in the same table or another.

    Parameters
    ----------
    steps : int array of shape (N,)
        Indices of the later updates, the latest first.
    links, later : Links and Gaussians
        Those of the table of the later updates: its links, and its smoothed hypotheses.
    filtered, smoothed : Gaussians
        Those of the table of the earlier updates: its filtered hypotheses, and the smoothed ones,
        which are written.
    """
    (modes, classes), count, rows, edges = links.share.shape[1:], len(pairs.before), 0, 0
    for index in steps:
        update = updates.rows[index]
        rows = max(rows, update[PREDICTED + 1] - update[PREDICTED])
        edges = max(edges, update[EDGE + 1] - update[EDGE])
    successors = Gaussians(
        np.empty((rows, modes, classes)),
        np.empty((rows, modes, SIZE)),
        np.empty((rows, modes, SIZE, SIZE)),
    )
    scratch = _Scratch(
        successors,
        np.empty(count, np.int64),
        np.empty(count),
        np.empty(count),
        np.empty((count, classes)),
        np.empty((count, SIZE)),
        np.empty((count, SIZE, SIZE)),
        np.empty(SIZE),
        np.empty((edges, modes)),
        np.empty((rows, modes)),
        np.empty((modes, classes)),
        np.empty(modes),
    )
    _go_back(pairs, steps, updates, links, later, filtered, smoothed, scratch)
