"""New targets without detections: births at configured places, and spawned targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compilation import SIZE, BySize, Float2, Float3, Float4, Int1, Writeable, compiled, in_place
from ..tracks import track_numbers
from .algebra.blocks import add_mean, add_spread, total_of
from .algebra.curvature import Moved, move, new_moved
from .dynamics import Dynamics, Motion, Spawned
from .mixture import Hypotheses, Mixture
from .prediction import AgedMixture


def births(terms: Sequence[tuple[int, float]], dynamics: Dynamics, scan_index: int) -> Mixture:
    """Return the birth components at the configured places, each with a new label.

    Parameters
    ----------
    terms : sequence of (int, float)
        Index of each birth term, and the time since its last births, seconds.
    """
    first = track_numbers.first_predicted(scan_index)
    rows = np.array([index for index, _ in terms], dtype=np.int64)
    expected = np.array([dt for _, dt in terms]) / dynamics.model.modes.interval_s
    weight, mean, covariance = dynamics.births
    weight = expected[:, None, None] * weight.take(rows, axis=0)
    return dynamics.nothing.changed(
        row_label=first + rows,
        weight=weight,
        mean=mean.take(rows, axis=0),
        covariance=covariance.take(rows, axis=0),
        snr=dynamics.unknown_snr(len(rows)),
    )


class Place(NamedTuple):
    """Where a target is said to be."""

    position: tuple[float, float]  # World frame, metres
    velocity: tuple[float, float]  # Metres per second


def placed(places: Sequence[Place], dynamics: Dynamics, scan_index: int) -> Mixture:
    """Return targets at places that somebody has given, each with a new label.

    The errors of a position given by hand are assumed to be `PLACE_STD`, and those of a velocity to
    be those of births at detections. The classes are equally probable.
    """
    model, modes = dynamics.model, dynamics.model.modes
    births, count = model.detection_births, len(places)
    std = modes.space.state(PLACE_STD, births.velocity_std, births.turn_rate_std, PLACE_HEIGHT_STD)
    mean = np.zeros((count, len(modes.space)))
    for row, (position, velocity) in enumerate(places):
        mean[row] = modes.space.state(position, velocity, 0.0)
    weight = PLACED_EXISTENCE * dynamics.birth_weight.mean(axis=0)
    first = track_numbers.first_predicted(scan_index) + track_numbers.LABELS_PER_SCAN // 4
    return dynamics.nothing.changed(
        row_label=first + np.arange(count),
        weight=weight[None].repeat(count, axis=0),
        mean=mean[:, None] * dynamics.supported,
        covariance=dynamics.diagonal(std**2)[None].repeat(count, axis=0),
        snr=dynamics.unknown_snr(count),
    )


def spawn(
    earlier: Sequence[AgedMixture], dynamics: Dynamics, scan_index: int, least: float
) -> Mixture:
    """Return the spawned targets, one for each parent, each with a new label.

    Parameters
    ----------
    least : float
        Existence probability below which a spawned target is left out.

    Notes
    -----
    The parent's hypotheses are moment-matched by one Gaussian, which each motion mode predicts.
    """
    model, parts, write = dynamics.model, [], _spawn[dynamics.supported.shape[1]]
    label = track_numbers.first_predicted(scan_index) + len(model.births)
    for mixture, dt in earlier:
        rate = min(model.spawn.rate * dt / model.modes.interval_s, 1.0)
        motion, _ = dynamics.over(np.array([dt]))
        spawned = write(rate, least, mixture.hypotheses, dynamics.spawned, motion)
        if count := len(spawned.weight):
            row_label, snr = np.arange(label, label + count), dynamics.unknown_snr(count)
            columns = spawned._asdict()
            parts.append(dynamics.nothing.changed(row_label=row_label, snr=snr, **columns))
            label += count
    return Mixture.concatenate(parts) if parts else dynamics.nothing


# Standard deviations of a position given by hand, along each axis, and of height and climb rate in
# space, metres and m/s.
PLACE_STD, PLACE_HEIGHT_STD = 300.0, (3000.0, 5.0)
# Probability that a target is there: it is believed for some looks that do not detect it.
PLACED_EXISTENCE = 1.0 - 1e-6


class _Targets(NamedTuple):
    """The weights, which begin as zeros, and the Gaussians of the spawned targets."""

    weight: Float3
    mean: Float3
    covariance: Float4


class _Matched(NamedTuple):
    """The Gaussian matched to each parent's hypotheses, which begins as zeros; working arrays."""

    mean: Float2
    covariance: Float3
    moved: Moved


@in_place
def _write_spawned(
    rate: float,
    parents: Hypotheses,
    spawned_row: Int1,
    assumed: Spawned,
    motion: Motion,
    spawned: Writeable[_Targets],
    matched: Writeable[_Matched],
) -> None:
    """Write the spawned targets, after a motion over one interval.

    `spawned_row` is the row of each parent's spawned target, (T,), or -1.
    """
    target, existence, weight = parents.target, parents.existence, parents.weight
    mean, covariance, weight_by_parent = parents.mean, parents.covariance, assumed.weight
    modes, classes = weight.shape[1:]
    parent_mean, parent_covariance = matched.mean, matched.covariance
    for row in range(len(target)):
        child, parent_mass = spawned_row[target[row]], existence[target[row]]
        for mode in range(modes if child >= 0 else 0):
            add_mean(total_of(weight[row, mode]) / parent_mass, mean[row, mode], parent_mean[child])
            for class_id in range(classes):
                child_weights = weight_by_parent[mode * classes + class_id]
                for entry in range(len(child_weights)):
                    added = rate * weight[row, mode, class_id] * child_weights[entry]
                    spawned.weight[child, entry // classes, entry % classes] += added
    for row in range(len(target)):
        child, parent_mass = spawned_row[target[row]], existence[target[row]]
        for mode in range(modes if child >= 0 else 0):
            share, row_mean = total_of(weight[row, mode]) / parent_mass, mean[row, mode]
            if share > 0.0:
                add_spread(
                    share,
                    row_mean,
                    covariance[row, mode],
                    parent_mean[child],
                    parent_covariance[child],
                )
    for child in range(len(parent_mean)):
        for mode in range(modes):
            move(
                parent_mean[child],
                parent_covariance[child],
                motion.transition[0, mode],
                motion.turns[mode],
                motion.arc[0, mode],
                matched.moved,
            )
            for i in range(SIZE):
                spawned.mean[child, mode, i] = matched.moved.mean[i]
                for k in range(i + 1):
                    total = matched.moved.covariance[i, k] + assumed.noise[mode, i, k]
                    spawned.covariance[child, mode, i, k] = total
                    spawned.covariance[child, mode, k, i] = total


@BySize
@compiled
def _spawn(
    rate: float, least: float, parents: Hypotheses, assumed: Spawned, motion: Motion
) -> _Targets:
    """Return the spawned targets of parents that spawn one with a probability of at least `least`.

    For the other parameters see `_write_spawned`.
    """
    existence, (modes, classes), count = parents.existence, parents.weight.shape[1:], 0
    spawned_row = np.full(len(existence), -1)
    for parent in range(len(existence)):
        if existence[parent] > 0.0 and rate * existence[parent] >= least:
            spawned_row[parent] = count
            count += 1
    spawned = _Targets(
        np.zeros((count, modes, classes)),
        np.empty((count, modes, SIZE)),
        np.empty((count, modes, SIZE, SIZE)),
    )
    mean_of, spread_of = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    matched = _Matched(mean_of, spread_of, new_moved())
    _write_spawned(rate, parents, spawned_row, assumed, motion, spawned, matched)
    return spawned
