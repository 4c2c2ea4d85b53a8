"""The backward step over the window: smoothed Gaussians, weights and hypotheses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, IntArray, contiguous
from ..compilation import Float2, Float3, Float4, Int1, Int2, compiled, inner
from ..window.entries import Entry
from .algebra.blocks import SIZE, add_mean, add_spread, dot, log_determinant, square_distance
from .algebra.vectors import add, multiply, total_of, write_scaled
from .mixture import Mixture
from .prediction import Moves
from .window_graph import Link, generations, is_chain

# Smallest log fit of a pair of modes relative to the best pair: no pair is excluded for good.
LEAST_LOG_FIT = -50.0
# In the place of a log density that is not finite.
LEAST_DENSITY = -1e300


@dataclass(frozen=True)
class Later:
    """Predicted hypotheses conditioned on later scans.

    Parameters
    ----------
    moves : Moves
        The predictions that led to these hypotheses.
    weight : array of shape (H, R, S)
    mean, covariance : arrays of shape (H, R, D) and (H, R, D, D)
    """

    moves: Moves
    weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


@compiled
def _of_children(
    parents: int,
    child: Int1,
    parent: Int1,
    share: Float3,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return each parent's weight, mean and covariance; see `_before_update`."""
    modes, cells = weight.shape[1:]
    found, total = np.zeros((parents, modes, cells)), np.zeros((parents, modes))
    centre, spread = np.zeros((parents, modes, SIZE)), np.zeros((parents, modes, SIZE, SIZE))
    part = np.zeros((len(child), modes))
    for edge in range(len(child)):
        if parent[edge] < 0:
            continue
        for mode in range(modes):
            for cell in range(cells):
                given = weight[child[edge], mode, cell] * share[edge, mode, cell]
                found[parent[edge], mode, cell] += given
                part[edge, mode] += given
            total[parent[edge], mode] += part[edge, mode]
    for edge in range(len(child)):
        for mode in range(modes):
            if part[edge, mode] > 0.0:
                part[edge, mode] /= total[parent[edge], mode]
                at = centre[parent[edge], mode]
                add_mean(part[edge, mode], mean[child[edge], mode], at)
    for edge in range(len(child)):
        for mode in range(modes):
            if part[edge, mode] > 0.0:
                own, one = mean[child[edge], mode], covariance[child[edge], mode]
                at, around = centre[parent[edge], mode], spread[parent[edge], mode]
                add_spread(part[edge, mode], own, one, at, around)
    return found, centre, spread


@inner
def _fit(
    place: IntArray,
    to: IntArray,
    later_weight: FloatArray,
    later_mean: FloatArray,
    mean: FloatArray,
    factor: FloatArray,
    apart: FloatArray,
    fit: FloatArray,
) -> None:
    """Write how well the mean of each later mode fits what its pairs predicted, shape (K,).

    A normal density, divided by the largest of the pairs of the later mode; 1 for a single pair.
    """
    for mode in range(len(later_mean)):
        largest, many, some = -np.inf, 0, total_of(later_weight[mode]) > 0.0
        for pair in range(len(to)):
            if to[pair] == mode:
                fit[pair] = 1.0 if some and place[pair] >= 0 else 0.0
                many += place[pair] >= 0
        if many < 2 or not some:
            continue
        for pair in range(len(to)):
            if to[pair] == mode and place[pair] >= 0:
                at = place[pair]
                square = square_distance(factor[at], later_mean[mode], mean[at], apart)
                density = 0.5 * (log_determinant(factor[at]) - square)
                fit[pair] = density if math.isfinite(density) else LEAST_DENSITY
                largest = max(largest, fit[pair])
        for pair in range(len(to)):
            if to[pair] == mode and place[pair] >= 0:
                fit[pair] = math.exp(max(fit[pair] - largest, LEAST_LOG_FIT))


@inner
def _given_later(
    joint: FloatArray,
    to: IntArray,
    cells: FloatArray,
    row: int,
    later_weight: FloatArray,
    scratch: FloatArray,
) -> None:
    """Turn the joint weights of pairs (K, S) into those given the later modes' weights (R, S).

    `cells` has the transition matrix of a row's cells, [from, to], empty if cells do not change.
    """
    size = joint.shape[1]
    for mode in range(len(later_weight)):
        predicted, back = scratch[0, :size], scratch[1, :size]
        predicted[:] = 0.0
        for pair in range(len(to)):
            if to[pair] == mode:
                add(joint[pair], predicted)
        if len(cells):
            multiply(cells[row].T, predicted, back)
            predicted[:] = back
        for cell in range(size):
            some = predicted[cell] > 0.0
            back[cell] = later_weight[mode, cell] / predicted[cell] if some else 0.0
        if len(cells):
            multiply(cells[row], back, predicted)
            back[:] = predicted
        for pair in range(len(to)):
            if to[pair] == mode:
                for cell in range(size):
                    joint[pair, cell] *= back[cell]


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
    share: float, own: FloatArray, own_spread: FloatArray, mean: FloatArray, spread: FloatArray
) -> None:
    """Add a share of a mode's own Gaussian, that of a target that dies, to the one given later."""
    if share > 0.0:
        for i in range(SIZE):
            for k in range(SIZE):
                between = (1.0 - share) * (own[i] - mean[i]) * (own[k] - mean[k])
                spread[i, k] += share * (own_spread[i, k] - spread[i, k] + between)
        for i in range(SIZE):
            mean[i] += share * (own[i] - mean[i])


@compiled
def _smoothed(
    target: Int1,
    targets: int,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
    of: Int1,
    to: Int1,
    change: Float2,
    survival: Float2,
    cells: Float3,
    place: Int2,
    pair_mean: Float2,
    factor: Float3,
    gain: Float3,
    base: Float3,
    later_weight: Float3,
    later_mean: Float3,
    later_covariance: Float4,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the smoothed weight, mean and covariance; see `_with_hindsight` and `Moves`."""
    count, modes, _ = weight.shape
    found, centre, spread = np.zeros(weight.shape), np.zeros(mean.shape), np.zeros(covariance.shape)
    alive, dead = np.zeros(targets), np.ones(targets)
    fit, mass, total = np.empty(len(of)), np.empty(len(of)), np.empty(modes)
    joint = np.empty((len(of), weight.shape[2]))
    moved, around = np.empty((len(of), SIZE)), np.empty((len(of), SIZE, SIZE))
    scratch = np.empty((2, max(SIZE, weight.shape[2])))
    for row in range(count):
        for mode in range(modes):
            dead[target[row]] -= survival[row, mode] * total_of(weight[row, mode])
        if not np.max(later_weight[row]) > 0.0:
            continue
        _fit(place[row], to, later_weight[row], later_mean[row], pair_mean, factor, scratch[0], fit)
        for pair in range(len(of)):
            write_scaled(change[row, pair] * fit[pair], weight[row, of[pair]], joint[pair])
        _given_later(joint, to, cells, row, later_weight[row], scratch)
        total[:] = 0.0
        for pair in range(len(of)):
            at, mode = place[row, pair], of[pair]
            mass[pair] = total_of(joint[pair])
            total[mode] += mass[pair]
            if mass[pair] > 0.0:
                add(joint[pair], found[row, mode])
                later = later_mean[row, to[pair]], later_covariance[row, to[pair]]
                columns = mean[row, mode], pair_mean[at], gain[at], base[at]
                _earlier(columns, later, scratch[0], moved[pair], around[pair])
        for pair in range(len(of)):
            if mass[pair] > 0.0:
                mass[pair] /= total[of[pair]]
                add_mean(mass[pair], moved[pair], centre[row, of[pair]])
        for pair in range(len(of)):
            if mass[pair] > 0.0:
                to_mean, to_spread = centre[row, of[pair]], spread[row, of[pair]]
                add_spread(mass[pair], moved[pair], around[pair], to_mean, to_spread)
        for mode in range(modes):
            alive[target[row]] += total[mode]
    for row in range(count):
        one = target[row]
        death = (1.0 - min(alive[one], 1.0)) / dead[one] if dead[one] > 0.0 else 0.0
        for mode in range(modes):
            died = death * (1.0 - survival[row, mode])
            gone, left = died * total_of(weight[row, mode]), total_of(found[row, mode])
            share = gone / (left + gone) if left > 0.0 else 1.0
            own, own_spread = mean[row, mode], covariance[row, mode]
            _blend(share, own, own_spread, centre[row, mode], spread[row, mode])
            for cell in range(weight.shape[2]):
                found[row, mode, cell] += died * weight[row, mode, cell]
    return found, centre, spread


def _before_update(smoothed: Mixture, link: Link) -> Later:
    """Return the predicted hypotheses, given their smoothed children.

    A predicted hypothesis has the summed weight of its smoothed children, and its Gaussians match
    their moments. The weight of a child that was merged from several parents is divided among
    them in proportion to their filtered weights. A hypothesis without children has no weight.
    """
    ancestry, moves = link.ancestry, link.moves
    columns = _of_children(
        len(moves.change),
        *contiguous(ancestry.child, ancestry.parent, ancestry.share),
        *contiguous(smoothed.weight, smoothed.mean, smoothed.covariance),
    )
    return Later(moves, *columns)


def _with_hindsight(own: Mixture, later: Later) -> Mixture:
    """Return the smoothed mixture of one scan, given the later predicted hypotheses.

    Notes
    -----
    A later mode j divides its smoothed weight among the pairs (i, j) of earlier modes i in
    proportion to w_i P_s pi_ij N(m_j; m_ij, P_ij), where m_j is the smoothed mean and m_ij, P_ij
    are the pair's predicted mean and covariance. The state of a pair follows by a backward step
    from the smoothed later state: the expectation correction. Without the normal density this is
    Kim's smoother, whose error grows with the lag; in a turn the growth cancels its gain. The
    weight of targets that die has the factor of a Bernoulli target's death,
    (1 - smoothed survivors) / (1 - filtered survivors).

    References
    ----------
    Barber, "Expectation correction for smoothed inference in switching linear dynamical systems",
    Journal of Machine Learning Research 7, 2006.
    Kim, "Dynamic linear models with Markov-switching", Journal of Econometrics 60, 1994.
    """
    moves = later.moves
    cells = np.zeros((0, 0, 0)) if moves.cells is None else moves.cells
    columns = _smoothed(
        *(own.target, len(own.label), own.weight, own.mean, own.covariance),
        *contiguous(*moves.pairs, moves.change, moves.survival, cells),
        *contiguous(moves.place, moves.mean, moves.factor, moves.gain, moves.base),
        *contiguous(later.weight, later.mean, later.covariance),
    )
    return own.with_gaussians(*columns)


def _smooth_chain(chain: Sequence[tuple[Mixture, Link | None]]) -> Iterator[Mixture]:
    """Yield the smoothed mixtures of a chain of filtered ones, newest first."""
    later: Mixture | None = None
    link: Link | None = None
    for filtered, before in chain:
        if later is None or link is None:
            later = filtered
        else:
            later = _with_hindsight(filtered, _before_update(later, link))
        yield later
        link = before


def backward_pass(entries: Sequence[Entry[Mixture, Link]]) -> list[Mixture]:
    """Return the smoothed mixtures of a window, newest first: lag 0, lag 1 and so on.

    Parameters
    ----------
    entries : sequence of Entry
        Oldest first. A source outside these entries has left the window.
    """
    if is_chain(entries):
        return list(_smooth_chain([(entry.stored, entry.link) for entry in reversed(entries)]))
    parts = generations(entries)
    weight, mean, covariance = (
        np.concatenate([getattr(entry.stored, column) for entry in entries])
        for column in ("weight", "mean", "covariance")
    )
    smoothed = _smooth_chain([(part.stored, part.link) for part in parts])
    for part, mixture in zip(parts, smoothed, strict=True):
        weight[part.rows] = mixture.weight
        mean[part.rows], covariance[part.rows] = mixture.mean, mixture.covariance
    ends = np.cumsum([len(entry.stored) for entry in entries])[:-1]
    columns = (np.split(column, ends) for column in (weight, mean, covariance))
    whole = zip(entries, *columns, strict=True)
    return [entry.stored.with_gaussians(*parts) for entry, *parts in whole][::-1]
