"""Prediction: survivors move and switch modes, targets are spawned, targets are born."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, contiguous
from ..compilation import Float2, Float3, Float4, Int1, Int2, compiled
from ..snapshot import MAX_STATE, floats, integers
from ..tracks import labels
from .algebra.blocks import SIZE, add_mean, add_spread, copy_gaussian, dot, factorise, solve
from .algebra.curvature import moved
from .algebra.kalman import predicted_covariance
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

    # Tuple of two int arrays of shape (K,). Modes of each pair before and after the prediction.
    pairs: tuple[IntArray, IntArray]
    # Probability of survival with a change from the first mode to the second, (H, K).
    change: Annotated[FloatArray, floats("PK", 0.0, 1.0)]
    # Probability of survival until the later scan, (H, R).
    survival: Annotated[FloatArray, floats("PO", 0.0, 1.0)]
    # Predicted mean of each pair, (A, D).
    mean: Annotated[FloatArray, floats("AD", -MAX_STATE, MAX_STATE)]
    # (A, D, D). Factors of each pair's predicted covariance; see `blocks.factorise`.
    factor: Annotated[FloatArray, floats("ADD", -MOST_FACTOR, MOST_FACTOR)]
    # `gain`, `base`: the backward step: given a later Gaussian of mean m and covariance P, the
    # earlier one has its own mean + gain (m - mean), and the covariance base + gain P gain', (A, D,
    # D).
    gain: Annotated[FloatArray, floats("ADD", -MOST_GAIN, MOST_GAIN)]
    # A small difference of large covariances: rounding may leave it indefinite.
    base: Annotated[FloatArray, floats("ADD", -(MAX_STATE**2), MAX_STATE**2)]
    # (H, K). Row of each pair in the arrays of A rows; -1 if the pair has no weight.
    place: Annotated[IntArray, integers("PK", -1, below="A")]


@compiled
def _pairs(
    covariance: Float4,
    row: Int1,
    of: Int1,
    to: Int1,
    source: Int1,
    jacobian: Float3,
    curved: Float3,
    noise: Float4,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the predicted covariance of each pair, its factors, gain and base; see `Moves`.

    `row`, `of` and `to` are the hypothesis and the modes of each pair; `source` is the scan whose
    interval gives the noise. For `jacobian` and `curved` see `curvature.moved`.
    """
    count = len(row)
    later, factor = np.empty((count, SIZE, SIZE)), np.empty((count, SIZE, SIZE))
    gain, base = np.empty((count, SIZE, SIZE)), np.empty((count, SIZE, SIZE))
    cross = np.empty((SIZE, SIZE))  # of the earlier and the later state
    for pair in range(count):
        before, turn = covariance[row[pair], of[pair]], jacobian[pair]
        added = noise[source[pair], to[pair]]
        for i in range(SIZE):
            for k in range(SIZE):
                cross[i, k] = dot(before[i], turn[k])
        for i in range(SIZE):
            for k in range(i + 1):
                total = added[i, k] + curved[pair, i, k]
                for n in range(SIZE):
                    total += turn[i, n] * cross[n, k]
                later[pair, i, k] = later[pair, k, i] = total
        factorise(later[pair], factor[pair])
        for i in range(SIZE):
            gain[pair, i] = cross[i]
            solve(factor[pair], gain[pair, i])
            for k in range(i + 1):
                total = before[i, k] - dot(gain[pair, i], cross[k])
                base[pair, i, k] = base[pair, k, i] = total
    return later, factor, gain, base


@compiled
def _mixed(
    weight: Float3,
    mean: Float3,
    covariance: Float4,
    of: Int1,
    to: Int1,
    change: Float2,
    place: Int2,
    pair_mean: Float2,
    pair_covariance: Float3,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weight, mean and covariance of each later mode, matched over its pairs.

    A mode that cannot be reached has no weight; it keeps its own Gaussian.
    """
    count, modes, classes = weight.shape
    later_weight, later_mean = np.zeros(weight.shape), np.zeros(mean.shape)
    later = np.zeros(covariance.shape)
    share, total = np.empty(len(of)), np.empty(modes)
    for row in range(count):
        total[:] = 0.0
        for pair in range(len(of)):
            share[pair] = 0.0
            for class_id in range(classes):
                moved = change[row, pair] * weight[row, of[pair], class_id]
                later_weight[row, to[pair], class_id] += moved
                share[pair] += moved
            total[to[pair]] += share[pair]
        for pair in range(len(of)):
            if share[pair] > 0.0:
                share[pair] /= total[to[pair]]
                add_mean(share[pair], pair_mean[place[row, pair]], later_mean[row, to[pair]])
        for pair in range(len(of)):
            mode, at = to[pair], place[row, pair]
            if share[pair] > 0.0:
                centre, spread = later_mean[row, mode], later[row, mode]
                add_spread(share[pair], pair_mean[at], pair_covariance[at], centre, spread)
        for mode in range(modes):
            if not total[mode] > 0.0:
                own, spread = mean[row, mode], covariance[row, mode]
                copy_gaussian(own, spread, later_mean[row, mode], later[row, mode])
    return later_weight, later_mean, later


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
    dt_of = np.array([dt for _, dt in earlier])
    intervals = [dynamics.over(dt) for _, dt in earlier]
    of, to = dynamics.pairs
    change = np.array([interval.change for interval in intervals])[source]
    survival = np.array([interval.survival for interval in intervals])[source]
    noise = np.array([interval.noise for interval in intervals])
    row, pair = np.nonzero((before.mode_weight[:, of] > 0.0) & (change > 0.0))
    place = np.full(change.shape, -1)
    place[row, pair] = np.arange(len(row))
    row, earlier_mode, later_mode, scan = contiguous(row, of[pair], to[pair], source[row])
    transition = np.array([interval.transition for interval in intervals])
    pair_mean, jacobian, curved = moved(
        *(before.mean, before.covariance, row, earlier_mode, later_mode, scan),
        *(dynamics.turns, transition, dt_of),
    )
    pair_covariance, factor, gain, base = _pairs(
        before.covariance, row, earlier_mode, later_mode, scan, jacobian, curved, noise
    )
    weight, mean, covariance = _mixed(
        *contiguous(before.weight, before.mean, before.covariance),
        *contiguous(of, to, change, place, pair_mean, pair_covariance),
    )
    diffused = [
        _diffused(part.mixture.snr, interval.snr)
        for part, interval in zip(earlier, intervals, strict=True)
    ]
    return (
        Mixture(before.row_label, weight, mean, covariance, np.concatenate(diffused)),
        Moves((of, to), change, survival, pair_mean, factor, gain, base, place),
    )


def _diffused(snr: FloatArray, transition: FloatArray | None) -> FloatArray:
    """Return the later probabilities of the cells of SNR, (H, C, S); see `Interval.snr`."""
    return snr if transition is None else (snr.swapaxes(0, 1) @ transition).swapaxes(0, 1)


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
    weight = expected[:, None, None] * weight[rows]
    snr = dynamics.unknown_snr(len(rows))
    return Mixture(first + rows, weight, mean[rows], covariance[rows], snr)


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
    parts = [dynamics.nothing]
    for mixture, dt in earlier:
        rate = min(model.spawn.rate * dt / model.modes.interval_s, 1.0)
        if rate * mixture.existence.max(initial=0.0) < least:
            continue
        parents = np.flatnonzero(rate * mixture.existence >= least)
        part = _spawned_by(mixture, parents, rate, dt, dynamics, label)
        label += len(part)
        parts.append(part)
    return Mixture.concatenate(parts)


def _spawned_by(
    mixture: Mixture, parents: IntArray, rate: float, dt: float, dynamics: Dynamics, label: int
) -> Mixture:
    mean, covariance = mixture.overall
    mean, covariance = mean[parents], covariance[parents]
    count, (modes, size) = len(parents), dynamics.supported.shape
    row, to = np.divmod(np.arange(count * modes), modes)
    nought, transition = np.zeros(len(to), dtype=np.int64), dynamics.over(dt).transition[None]
    found = moved(
        *(mean[:, None], covariance[:, None], row, nought, to, nought),
        *(dynamics.turns, transition, np.array([dt])),
    )
    later = found[0].reshape(count, modes, -1)
    jacobian, curved = (matrix.reshape(count, modes, size, -1) for matrix in found[1:])
    by_parent, noise = dynamics.spawned
    spread = predicted_covariance(covariance[:, None], jacobian, noise + curved)[0]
    place = np.full(len(mixture.label), count)
    place[parents] = np.arange(count)
    weight = np.zeros((count + 1, len(by_parent)))
    np.add.at(weight, place[mixture.target], mixture.weight.reshape(len(mixture), -1))
    weight = rate * (weight[:count] @ by_parent).reshape(count, modes, -1)
    return Mixture(label + np.arange(count), weight, later, spread, dynamics.unknown_snr(count))
