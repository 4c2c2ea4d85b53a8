"""The backward step, compiled: smoothed hypotheses, given the later ones that continue them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float2, Float3, Float4, Int1, Int2, compiled, inner
from .algebra.blocks import (
    SIZE,
    add_mean,
    add_spread,
    copy_gaussian,
    dot,
    log_determinant,
    square_distance,
)
from .algebra.vectors import add, sum_of, total_of, write_scaled

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0
# Replaces a log density that is not finite.
LEAST_DENSITY = -1e300


class Gaussians(NamedTuple):
    """Weights, means and covariances of N rows by motion mode, as of `Mixture`."""

    weight: Float3
    mean: Float3
    covariance: Float4


class _Moves(NamedTuple):
    """The predictions of rows; see `prediction.Moves`."""

    of: IntArray
    to: IntArray
    change: FloatArray
    survival: FloatArray
    mean: FloatArray
    factor: FloatArray
    gain: FloatArray
    base: FloatArray
    place: IntArray


class _Scratch(NamedTuple):
    """What the smoothing of one row needs, allocated once."""

    # `fit`, `mass`: (K,).
    fit: FloatArray
    mass: FloatArray
    joint: FloatArray  # (K, C)
    # `mean`, `covariance`: (K, D) and (K, D, D). The earlier Gaussians of the pairs.
    mean: FloatArray
    covariance: FloatArray
    vector: FloatArray  # (D,)


@inner
def _scratch(pairs: int, classes: int) -> _Scratch:
    return _Scratch(
        np.empty(pairs),
        np.empty(pairs),
        np.empty((pairs, classes)),
        np.empty((pairs, SIZE)),
        np.empty((pairs, SIZE, SIZE)),
        np.empty(SIZE),
    )


@inner
def _of_children(
    count: int, child: IntArray, parent: IntArray, share: FloatArray, later: Gaussians
) -> Gaussians:
    """Return `count` predicted hypotheses, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a child that was merged from several parents is divided among
    them in proportion to their filtered weights. A hypothesis without children has no weight.
    """
    modes, classes = later.weight.shape[1:]
    weight, total = np.zeros((count, modes, classes)), np.zeros((count, modes))
    mean, covariance = np.zeros((count, modes, SIZE)), np.zeros((count, modes, SIZE, SIZE))
    part = np.zeros((len(child), modes))
    for edge in range(len(child)):
        one, other = parent[edge], child[edge]
        if one < 0:
            continue
        for mode in range(modes):
            for class_id in range(classes):
                given = later.weight[other, mode, class_id] * share[edge, mode, class_id]
                weight[one, mode, class_id] += given
                part[edge, mode] += given
            total[one, mode] += part[edge, mode]
    for edge in range(len(child)):
        one, other = parent[edge], child[edge]
        for mode in range(modes):
            if part[edge, mode] > 0.0:
                part[edge, mode] /= total[one, mode]
                add_mean(part[edge, mode], later.mean[other, mode], mean[one, mode])
    for edge in range(len(child)):
        one, other = parent[edge], child[edge]
        for mode in range(modes):
            if part[edge, mode] > 0.0:
                own, around = later.mean[other, mode], later.covariance[other, mode]
                at, spread = mean[one, mode], covariance[one, mode]
                add_spread(part[edge, mode], own, around, at, spread)
    return Gaussians(weight, mean, covariance)


@inner
def _write_fit(
    moves: _Moves, row: int, later: Gaussians, at: int, apart: FloatArray, fit: FloatArray
) -> None:
    """Write how well the mean of each later mode fits what its pairs predicted, shape (K,).

    A normal density, divided by the largest of the pairs of the later mode; 1 for a single pair.
    """
    to, place = moves.to, moves.place[row]
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
                factor, predicted = moves.factor[place[pair]], moves.mean[place[pair]]
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
        for k in range(SIZE):
            half[k] = dot(gain[i], later_covariance[k])
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
    own: Gaussians, at: int, moves: _Moves, row: int, later: Gaussians, part: int, scratch: _Scratch
) -> None:
    """Write the joint weights and the earlier Gaussians of a row's pairs, given later modes."""
    of, to, fit, mass = moves.of, moves.to, scratch.fit, scratch.mass
    _write_fit(moves, row, later, part, scratch.vector, fit)
    for pair in range(len(of)):
        prior = moves.change[row, pair] * fit[pair]
        write_scaled(prior, own.weight[at, of[pair]], scratch.joint[pair])
    _given_later(scratch.joint, to, later.weight[part])
    for pair in range(len(of)):
        mass[pair] = total_of(scratch.joint[pair])
        if mass[pair] > 0.0:
            one = moves.place[row, pair]
            columns = own.mean[at, of[pair]], moves.mean[one], moves.gain[one], moves.base[one]
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
    """Add to a row what died of it; `death` is the factor on the weight of those that die."""
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
    smoothed: Gaussians,
    of: Int1,
    to: Int1,
    edges: Int1,
    rows: Int1,
    child: Int1,
    parent: Int1,
    share: Float3,
    change: Float2,
    survival: Float2,
    pair_mean: Float2,
    factor: Float3,
    gain: Float3,
    base: Float3,
    place: Int2,
    source: Int1,
    target: Int1,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
    later_weight: Float3,
    later_mean: Float3,
    later_covariance: Float4,
) -> None:
    """Write the smoothed rows that links continue, given the later rows, link by link.

    Parameters
    ----------
    smoothed : Gaussians
        The rows to write, which may be later rows of the links that follow.
    of, to : int arrays of shape (K,)
        The pairs of motion modes of `prediction.Moves`.
    edges, rows : int arrays of shape (L + 1,)
        Where the edges and the predicted rows of each link begin, and where those of the last end.
    child, parent, share : arrays of shapes (E,), (E,) and (E, R, C)
        See `reduction.Ancestry`; a parent is counted from the first predicted row of its link.
    change, survival, pair_mean, factor, gain, base, place
        See `prediction.Moves`.
    source : int array of shape (P,)
        The filtered row from which each row was predicted; -1 if it has left the window.
    target : int array of shape (N,)
        The target of each filtered row.
    weight, mean, covariance : arrays of shapes (N, R, C), (N, R, D) and (N, R, D, D)
        The filtered rows.
    later_weight, later_mean, later_covariance : arrays
        The later rows.
    """
    moves = _Moves(of, to, change, survival, pair_mean, factor, gain, base, place)
    own = Gaussians(weight, mean, covariance)
    later = Gaussians(later_weight, later_mean, later_covariance)
    targets = target.max() + 1 if len(target) else 0
    alive, dead = np.zeros(targets), np.ones(targets)
    scratch = _scratch(len(of), weight.shape[2])
    for link in range(len(rows) - 1):
        begin, end, part = rows[link], rows[link + 1], slice(edges[link], edges[link + 1])
        ahead = _of_children(end - begin, child[part], parent[part], share[part], later)
        for row in range(begin, end):
            at = source[row]
            if at < 0:
                continue
            smoothed.weight[at], smoothed.mean[at], smoothed.covariance[at] = 0.0, 0.0, 0.0
            for mode in range(weight.shape[1]):
                dead[target[at]] -= survival[row, mode] * total_of(weight[at, mode])
            if sum_of(ahead.weight[row - begin]) > 0.0:
                _write_row(own, at, moves, row, ahead, row - begin, scratch)
                alive[target[at]] += _add_pairs(of, scratch, smoothed, at)
        for row in range(begin, end):
            at = source[row]
            if at >= 0:
                one = target[at]
                death = (1.0 - min(alive[one], 1.0)) / dead[one] if dead[one] > 0.0 else 0.0
                _add_deaths(death, survival[row], own, at, smoothed, scratch.vector)
