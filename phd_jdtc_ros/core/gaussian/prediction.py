"""Prediction: the targets that survive move and switch modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import (
    SIZE,
    BySize,
    Float1,
    Float2,
    Float3,
    Float4,
    Int1,
    Int2,
    Writeable,
    compiled,
    in_place,
    inner,
)
from ..snapshot import MAX_STATE, floats, integers
from .algebra.blocks import (
    add_mean,
    add_spread,
    check_matrices,
    copy_gaussian,
    dot,
    factorise,
    solve,
    write,
)
from .algebra.curvature import OMEGA, Moved, move, new_moved
from .dynamics import Dynamics, ModePairs, Motion
from .mixture import Gaussians, Mixture

# Bounds on values in a snapshot: on the gains of the backward step, which are largest in metres per
# radian per second, and on the entries of covariance factors.
MOST_GAIN, MOST_FACTOR = 1e15, 1e30


class AgedMixture(NamedTuple):
    """A stored mixture and its age."""

    mixture: Mixture
    dt: float  # Time since its scan, seconds


@dataclass(frozen=True)
class Moves:
    """The prediction from the hypotheses of earlier scans, row by row, for the smoother."""

    pairs: ModePairs
    # Probability of survival with a change from the first mode to the second, (H, K).
    change: Annotated[FloatArray, floats("PK", 0.0, 1.0)]
    # Probability of survival until the later scan, (H, R).
    survival: Annotated[FloatArray, floats("PO", 0.0, 1.0)]
    # Predicted mean of each pair, (A, D).
    mean: Annotated[FloatArray, floats("AD", -MAX_STATE, MAX_STATE)]
    # Factors of the predicted covariances, (F, D, D), where several pairs lead to the same mode, so
    # that the backward step compares them; see `blocks.factorise`.
    factor: Annotated[FloatArray, floats("FDD", -MOST_FACTOR, MOST_FACTOR)]
    # Row of each pair's factor, (A,); -1 for none.
    factored: Annotated[IntArray, integers("A", -1, below="F")]
    # Gain of the backward step, (A, D, D). Given a later Gaussian of mean m and covariance P, the
    # earlier one has its own mean plus gain (m - mean), and the covariance base + gain P gain'.
    gain: Annotated[FloatArray, floats("ADD", -MOST_GAIN, MOST_GAIN)]
    # Covariance of the backward step, (A, D, D): a small difference of large covariances, which
    # rounding may leave indefinite.
    base: Annotated[FloatArray, floats("ADD", -(MAX_STATE**2), MAX_STATE**2)]
    # Row of each pair in the arrays of A rows, (H, K); -1 if the pair has no weight.
    place: Annotated[IntArray, integers("PK", -1, below="A")]


class _Predicted(NamedTuple):
    """The predicted hypotheses, which begin as zeros, and the columns of `Moves`."""

    weight: Float3
    mean: Float3
    covariance: Float4
    change: Float2
    survival: Float2
    pair_mean: Float2
    factor: Float3
    factored: Int1
    gain: Float3
    base: Float3
    place: Int2


class _Scratch(NamedTuple):
    """Working arrays for the prediction of one hypothesis."""

    spread: Float3  # Predicted covariance of each pair, (K, D, D)
    share: Float1  # Share of each pair in its later mode, (K,)
    total: Float1  # Weight of each later mode, (R,)
    factor: Float2  # First the covariance of a begun turn, then a factor that is not kept, (D, D)
    moved: Moved


@inner
def _write_pair_places(
    weight: FloatArray,
    pairs: ModePairs,
    change: FloatArray,
    place: IntArray,
    factored: IntArray,
) -> tuple[int, int]:
    """Write the places of the pairs that have weight; return their number, and that of factors.

    `factored`, a column of `Moves`, has room for all pairs.
    """
    (count, _, classes), active, factors = weight.shape, 0, 0
    from_mode, to_mode = pairs
    for row in range(count):
        for pair in range(len(from_mode)):
            has_weight = False
            for class_id in range(classes):
                has_weight = has_weight or weight[row, from_mode[pair], class_id] > 0.0
            place[row, pair] = -1
            if has_weight and change[row, pair] > 0.0:
                place[row, pair], factored[active] = active, -1
                active += 1
        for pair in range(len(from_mode)):
            has_rival = False
            for other in range(len(from_mode)):
                rival = other != pair and to_mode[other] == to_mode[pair]
                has_rival = has_rival or (rival and place[row, other] >= 0)
            if has_rival and place[row, pair] >= 0:
                factored[place[row, pair]] = factors
                factors += 1
    return active, factors


@inner
def _write_shares(
    row: int, weight: FloatArray, pairs: ModePairs, later: _Predicted, scratch: _Scratch
) -> None:
    """Write a hypothesis's later weights, the weight of each pair, and that of each later mode."""
    (from_mode, to_mode), change = pairs, later.change[row]
    share, total = scratch.share, scratch.total
    for mode in range(len(total)):
        total[mode] = 0.0
    for pair in range(len(from_mode)):
        share[pair] = 0.0
        for class_id in range(weight.shape[2]):
            arriving = change[pair] * weight[row, from_mode[pair], class_id]
            later.weight[row, to_mode[pair], class_id] += arriving
            share[pair] += arriving
        total[to_mode[pair]] += share[pair]


@inner
def _write_pair(
    pair: int,
    pair_row: int,
    gaussian: tuple[FloatArray, FloatArray],
    motion: Motion,
    interval: int,
    mode: int,
    later: _Predicted,
    scratch: _Scratch,
) -> None:
    """Write the prediction of a pair, with its covariance in `spread`, and its backward step.

    `gaussian` is the mean and the covariance before, and `mode` the mode after.
    """
    (mean, covariance), noise = gaussian, motion.noise[interval, mode]
    moved, gain, base = scratch.moved, later.gain[pair_row], later.base[pair_row]
    spread, transition = scratch.spread[pair], motion.transition[interval, mode]
    before = covariance
    if motion.begun[mode] > 0.0 and covariance[OMEGA, OMEGA] == 0.0:
        before = scratch.factor
        for i in range(SIZE):
            write(covariance[i], before[i])
        before[OMEGA, OMEGA] = motion.begun[mode]
    move(mean, before, transition, motion.turns[mode], motion.arc[interval, mode], moved)
    for i in range(SIZE):
        later.pair_mean[pair_row, i] = moved.mean[i]
        for k in range(i + 1):
            spread[i, k] = spread[k, i] = moved.covariance[i, k] + noise[i, k]
    factor_row = later.factored[pair_row]
    factor = later.factor[factor_row] if factor_row >= 0 else scratch.factor
    factorise(spread, factor)
    for i in range(SIZE):
        if covariance[i, i] == 0.0:  # The mode has no such axis.
            for k in range(SIZE):
                gain[i, k] = 0.0
                base[i, k] = base[k, i] = 0.0
            continue
        write(solve(factor, moved.cross[i]), gain[i])
        for k in range(i + 1):
            base[i, k] = base[k, i] = covariance[i, k] - dot(gain[i], moved.cross[k])


@in_place
def _write_predicted(
    gaussians: Gaussians,
    interval_of: Int1,
    pairs: ModePairs,
    motion: Motion,
    later: Writeable[_Predicted],
    scratch: Writeable[_Scratch],
) -> None:
    """Write the later hypotheses and the moves; `interval_of` has the interval of each."""
    (weight, mean, covariance), (from_mode, to_mode) = gaussians, pairs
    spread, share, total, spare, moved = scratch
    for matrices in (later.gain, later.base, later.factor, spread):
        check_matrices(matrices)
    for matrix in (spare, moved.cross, moved.covariance):
        check_matrices(matrix)
    for row in range(len(weight)):
        interval = interval_of[row]
        _write_shares(row, weight, pairs, later, scratch)
        for pair in range(len(from_mode)):
            pair_row, mode = later.place[row, pair], to_mode[pair]
            if pair_row < 0:
                continue
            gaussian = mean[row, from_mode[pair]], covariance[row, from_mode[pair]]
            _write_pair(pair, pair_row, gaussian, motion, interval, mode, later, scratch)
            if share[pair] > 0.0:
                share[pair] /= total[mode]
                add_mean(share[pair], later.pair_mean[pair_row], later.mean[row, mode])
        for pair in range(len(from_mode)):
            if share[pair] > 0.0:
                pair_mean, mode = later.pair_mean[later.place[row, pair]], to_mode[pair]
                later_mean, later_covariance = later.mean[row, mode], later.covariance[row, mode]
                add_spread(share[pair], pair_mean, spread[pair], later_mean, later_covariance)
        for mode in range(len(total)):
            if not total[mode] > 0.0:  # No mode leads to this one.
                later_mean, later_covariance = later.mean[row, mode], later.covariance[row, mode]
                copy_gaussian(mean[row, mode], covariance[row, mode], later_mean, later_covariance)


@BySize
@compiled
def _predict(
    gaussians: Gaussians, sizes: Int1, mode_pairs: ModePairs, motion: Motion
) -> _Predicted:
    """Return the later hypotheses and the moves; see `_write_predicted`.

    `sizes` has the number of hypotheses of each interval, which are adjacent.
    """
    weight, mean, covariance = gaussians
    survival, change = motion.survival, motion.change
    (count, modes), pairs, end = weight.shape[:2], len(mode_pairs.before), 0
    interval_of = np.empty(count, np.int64)
    row_change, row_survival = np.empty((count, pairs)), np.empty((count, modes))
    for interval in range(len(sizes)):
        end += sizes[interval]
        for row in range(end - sizes[interval], end):
            interval_of[row] = interval
            for pair in range(pairs):
                row_change[row, pair] = change[interval, pair]
            for mode in range(modes):
                row_survival[row, mode] = survival[interval, mode]
    place, factored = np.empty((count, pairs), np.int64), np.empty(count * pairs, np.int64)
    active, factors = _write_pair_places(weight, mode_pairs, row_change, place, factored)
    later = _Predicted(
        np.zeros(weight.shape),
        np.zeros(mean.shape),
        np.zeros(covariance.shape),
        row_change,
        row_survival,
        np.empty((active, SIZE)),
        np.empty((factors, SIZE, SIZE)),
        factored[:active].copy(),
        np.empty((active, SIZE, SIZE)),
        np.empty((active, SIZE, SIZE)),
        place,
    )
    spread, spare = np.empty((pairs, SIZE, SIZE)), np.empty((SIZE, SIZE))
    scratch = _Scratch(spread, np.empty(pairs), np.empty(modes), spare, new_moved())
    _write_predicted(gaussians, interval_of, mode_pairs, motion, later, scratch)
    return later


def survivors(earlier: Sequence[AgedMixture], dynamics: Dynamics) -> tuple[Mixture, Moves]:
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
    mixtures, dt = zip(*earlier, strict=True)
    stored, sizes = Mixture.concatenate(mixtures), np.array([*map(len, mixtures)])
    motion, snr = dynamics.over(np.array(dt))
    diffused = [_diffuse(part.snr, change) for part, change in zip(mixtures, snr, strict=True)]
    later = _predict[stored.mean.shape[2]](stored.gaussians, sizes, dynamics.pairs, motion)
    predicted = stored.changed(
        weight=later.weight,
        mean=later.mean,
        covariance=later.covariance,
        snr=diffused[0] if len(diffused) == 1 else np.concatenate(diffused),
    )
    return predicted, Moves(dynamics.pairs, *later[3:])


def _diffuse(snr: FloatArray, transition: FloatArray | None) -> FloatArray:
    """Return the predicted probabilities of the SNR cells, (H, C, S); see `Intervals.snr`."""
    if transition is None:
        return snr
    return np.ascontiguousarray((snr.swapaxes(0, 1) @ transition).swapaxes(0, 1))
