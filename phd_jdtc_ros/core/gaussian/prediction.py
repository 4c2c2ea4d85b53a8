"""Prediction: survivors move and switch modes, targets are spawned, targets are born."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Bool1, Float1, Float2, Float3, Float4, Int1, compiled
from ..snapshot import MAX_STATE, floats, integers
from ..tracks import labels
from .algebra.blocks import SIZE, add_mean, add_spread, copy_gaussian, dot, factorise, solve
from .algebra.curvature import move, new_moved
from .algebra.vectors import total_of
from .dynamics import Dynamics
from .mixture import Mixture

# Bounds in a snapshot: on the entries of a backward step, of which metres per radian per second are
# the largest, and on those of the factors of a covariance.
MOST_GAIN, MOST_FACTOR = 1e15, 1e30


class Aged(NamedTuple):
    """A stored mixture and its age."""

    mixture: Mixture
    dt: float  # Time since its scan, seconds


@dataclass(frozen=True)
class Moves:
    """The prediction from the hypotheses of earlier scans, row by row, for the smoother.

    Each of the K pairs is a motion mode before the prediction and a possible one after it.
    """

    # Modes of each pair before and after the prediction, (K,) each.
    pairs: tuple[IntArray, IntArray]
    # Probability of survival with a change from the first mode to the second, (H, K).
    change: Annotated[FloatArray, floats("PK", 0.0, 1.0)]
    # Probability of survival until the later scan, (H, R).
    survival: Annotated[FloatArray, floats("PO", 0.0, 1.0)]
    # Predicted mean of each pair, (A, D).
    mean: Annotated[FloatArray, floats("AD", -MAX_STATE, MAX_STATE)]
    # Factors of each pair's predicted covariance, (A, D, D); see `blocks.factorise`.
    factor: Annotated[FloatArray, floats("ADD", -MOST_FACTOR, MOST_FACTOR)]
    # Gain of the backward step, (A, D, D). Given a later Gaussian of mean m and covariance P, the
    # earlier one has its own mean plus gain (m - mean), and the covariance base + gain P gain'.
    gain: Annotated[FloatArray, floats("ADD", -MOST_GAIN, MOST_GAIN)]
    # Covariance of the backward step, (A, D, D): a small difference of large covariances, which
    # rounding may leave indefinite.
    base: Annotated[FloatArray, floats("ADD", -(MAX_STATE**2), MAX_STATE**2)]
    # Row of each pair in the arrays of A rows, (H, K); -1 if the pair has no weight.
    place: Annotated[IntArray, integers("PK", -1, below="A")]


@compiled
def _predicted(
    weight: Float3,
    mean: Float3,
    covariance: Float4,
    mode_weight: Float2,
    source: Int1,
    of: Int1,
    to: Int1,
    turns: Bool1,
    dt: Float1,
    change: Float2,
    noise: Float4,
    transition: Float4,
) -> tuple[Any, ...]:
    """Return the later weights, means and covariances, and the columns of `Moves` from `mean` on.

    `source` is the interval of each hypothesis; the last five parameters are by mode or interval.
    """
    count, modes, classes = weight.shape
    place, active = np.full((count, len(of)), -1), 0
    for row in range(count):
        for pair in range(len(of)):
            if mode_weight[row, of[pair]] > 0.0 and change[source[row], pair] > 0.0:
                place[row, pair] = active
                active += 1
    pair_mean, factor = np.empty((active, SIZE)), np.empty((active, SIZE, SIZE))
    gain, base = np.empty((active, SIZE, SIZE)), np.empty((active, SIZE, SIZE))
    later_weight, later_mean = np.zeros(weight.shape), np.zeros(mean.shape)
    later, spread = np.zeros(covariance.shape), np.empty((len(of), SIZE, SIZE))
    share, total, moved = np.empty(len(of)), np.empty(modes), new_moved()
    for row in range(count):
        own = source[row]
        total[:] = 0.0
        for pair in range(len(of)):
            share[pair] = 0.0
            for class_id in range(classes):
                arriving = change[own, pair] * weight[row, of[pair], class_id]
                later_weight[row, to[pair], class_id] += arriving
                share[pair] += arriving
            total[to[pair]] += share[pair]
        for pair in range(len(of)):
            at, mode = place[row, pair], to[pair]
            if at < 0:
                continue
            before = covariance[row, of[pair]]
            move(mean[row, of[pair]], before, transition[own, mode], turns[mode], dt[own], moved)
            for i in range(SIZE):
                pair_mean[at, i] = moved.mean[i]
                for k in range(i + 1):
                    found = moved.covariance[i, k] + noise[own, mode, i, k]
                    spread[pair, i, k] = spread[pair, k, i] = found
            factorise(spread[pair], factor[at])
            for i in range(SIZE):
                for k in range(SIZE):
                    gain[at, i, k] = moved.cross[i, k]
                solve(factor[at], gain[at, i])
                for k in range(i + 1):
                    found = before[i, k] - dot(gain[at, i], moved.cross[k])
                    base[at, i, k] = base[at, k, i] = found
            if share[pair] > 0.0:
                share[pair] /= total[mode]
                add_mean(share[pair], pair_mean[at], later_mean[row, mode])
        for pair in range(len(of)):
            if share[pair] > 0.0:
                at, mode = place[row, pair], to[pair]
                centre = later_mean[row, mode]
                add_spread(share[pair], pair_mean[at], spread[pair], centre, later[row, mode])
        for mode in range(modes):
            if not total[mode] > 0.0:  # it cannot be reached
                around = covariance[row, mode]
                copy_gaussian(mean[row, mode], around, later_mean[row, mode], later[row, mode])
    return later_weight, later_mean, later, pair_mean, factor, gain, base, place


def survivors(earlier: Sequence[Aged], dynamics: Dynamics) -> tuple[Mixture, Moves]:
    """Return the hypotheses of earlier scans predicted to the time of a later one.

    Notes
    -----
    Interacting multiple models: all Gaussians whose mode may change to a given mode are predicted
    with that mode's motion, weighted by their transition probabilities and moment-matched by one.

    References
    ----------
    Blom and Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian
    switching coefficients", IEEE Transactions on Automatic Control 33(8), 1988.
    """
    before = Mixture.concatenate([part.mixture for part in earlier])
    source = np.arange(len(earlier)).repeat([len(part.mixture) for part in earlier])
    dt = np.array([part.dt for part in earlier])
    survival, change, noise, transition, snr = dynamics.over(dt)
    weight, mean, covariance, *of_pairs = _predicted(
        *(*before.gaussians, before.mode_weight, source, *dynamics.pairs, dynamics.turns, dt),
        *(change, noise, transition),
    )
    diffused = [_diffused(part.mixture.snr, one) for part, one in zip(earlier, snr, strict=True)]
    of_row = change.take(source, axis=0), survival.take(source, axis=0)
    moved = before.changed(
        weight=weight, mean=mean, covariance=covariance, snr=np.concatenate(diffused)
    )
    return moved, Moves(dynamics.pairs, *of_row, *of_pairs)


def _diffused(snr: FloatArray, transition: FloatArray | None) -> FloatArray:
    """Return the later probabilities of the cells of SNR, (H, C, S); see `Intervals.snr`."""
    if transition is None:
        return snr
    return np.ascontiguousarray((snr.swapaxes(0, 1) @ transition).swapaxes(0, 1))


def births(births: Sequence[tuple[int, float]], dynamics: Dynamics, scan_index: int) -> Mixture:
    """Return the birth components at the configured places, each with a new label.

    Parameters
    ----------
    births : sequence of (int, float)
        Index of each birth term, and the time since its last births, seconds.
    """
    first = labels.first_predicted(scan_index)
    rows = np.array([index for index, _ in births], dtype=np.int64)
    expected = np.array([dt for _, dt in births]) / dynamics.model.modes.interval_s
    weight, mean, covariance = dynamics.births
    weight = expected[:, None, None] * weight.take(rows, axis=0)
    gaussians = mean.take(rows, axis=0), covariance.take(rows, axis=0)
    return Mixture(first + rows, weight, *gaussians, dynamics.unknown_snr(len(rows)))


def spawn(earlier: Sequence[Aged], dynamics: Dynamics, scan_index: int, least: float) -> Mixture:
    """Return the spawned targets, one for each parent, each with a new label.

    Parameters
    ----------
    least : float
        Existence probability below which a spawned target is left out.

    Notes
    -----
    The parent's hypotheses are moment-matched by one Gaussian, which each motion mode predicts.
    """
    model = dynamics.model
    label = labels.first_predicted(scan_index) + len(model.births)
    parts = []
    for mixture, dt in earlier:
        rate = min(model.spawn.rate * dt / model.modes.interval_s, 1.0)
        columns = _spawned(
            *(rate, least, dt, mixture.target, mixture.existence, *mixture.gaussians),
            *(*dynamics.spawned, dynamics.over(np.array([dt])).transition[0], dynamics.turns),
        )
        count = len(columns[0])
        if count:
            row_label = np.arange(label, label + count)
            parts.append(Mixture(row_label, *columns, dynamics.unknown_snr(count)))
        label += count
    return Mixture.concatenate(parts) if parts else dynamics.nothing


@compiled
def _spawned(
    rate: float,
    least: float,
    dt: float,
    target: Int1,
    existence: Float1,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
    by_parent: Float2,
    noise: Float3,
    transition: Float3,
    turns: Bool1,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weights and Gaussians of the spawned targets; see `Dynamics.spawned`."""
    modes, classes = weight.shape[1:]
    place, count = np.full(len(existence), -1), 0
    for parent in range(len(existence)):
        if existence[parent] > 0.0 and rate * existence[parent] >= least:
            place[parent] = count
            count += 1
    found, later = np.zeros((count, modes, classes)), np.empty((count, modes, SIZE))
    spread, moved = np.empty((count, modes, SIZE, SIZE)), new_moved()
    centre, around = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    for row in range(len(target)):
        one, whole = place[target[row]], existence[target[row]]
        for mode in range(modes if one >= 0 else 0):
            add_mean(total_of(weight[row, mode]) / whole, mean[row, mode], centre[one])
            for class_id in range(classes):
                share = by_parent[mode * classes + class_id]
                for entry in range(len(share)):
                    own = rate * weight[row, mode, class_id] * share[entry]
                    found[one, entry // classes, entry % classes] += own
    for row in range(len(target)):
        one, whole = place[target[row]], existence[target[row]]
        for mode in range(modes if one >= 0 else 0):
            part, own = total_of(weight[row, mode]) / whole, mean[row, mode]
            if part > 0.0:
                add_spread(part, own, covariance[row, mode], centre[one], around[one])
    for one in range(count):
        for mode in range(modes):
            move(centre[one], around[one], transition[mode], turns[mode], dt, moved)
            for i in range(SIZE):
                later[one, mode, i] = moved.mean[i]
                for k in range(i + 1):
                    total = moved.covariance[i, k] + noise[mode, i, k]
                    spread[one, mode, i, k] = spread[one, mode, k, i] = total
    return found, later, spread
