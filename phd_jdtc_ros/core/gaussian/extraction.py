"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..compilation import SIZE, BySize, Float2, Float3, Int1, compiled
from ..types import CONFIRMED, Estimates
from .algebra.blocks import (
    add,
    add_mean,
    add_spread,
    divergence,
    factorise,
    square_distance,
    total_of,
)
from .algebra.kalman import floor_eigenvalues, is_positive
from .dynamics import Dynamics
from .mixture import Gaussians, Hypotheses, Mixture


@BySize
@compiled
def _class_moments(
    threshold: float,
    target_count: int,
    target_of: Int1,
    row: Int1,
    gaussians: Gaussians,
) -> tuple[bool, IntArray, FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Return the targets whose mass is above a threshold, and the columns of their estimates.

    These are the mass, the probability of each class, the most probable class, and the moments of
    that class. The first result is whether all covariances are sound. `target_of` and `row` have
    the target of each hypothesis and its row in the Gaussians.
    """
    weight, mean, covariance = gaussians
    modes, classes = weight.shape[1:]
    of_class, output_row, count = np.zeros((target_count, classes)), np.full(target_count, -1), 0
    for index in range(len(row)):
        for mode in range(modes):
            add(weight[row[index], mode], of_class[target_of[index]])
    for target in range(target_count):
        if total_of(of_class[target]) > threshold:
            output_row[target] = count
            count += 1
    chosen, mass, majority = np.empty(count, np.int64), np.empty(count), np.empty(count, np.int64)
    probability = np.empty((count, classes))
    state, spread = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    for target in range(target_count):
        if output_row[target] >= 0:
            output, total_mass = output_row[target], total_of(of_class[target])
            chosen[output], mass[output] = target, total_mass
            majority[output] = 0
            for class_id in range(classes):
                mass_of_class = of_class[target, class_id]
                if mass_of_class > of_class[target, majority[output]]:
                    majority[output] = class_id
                probability[output, class_id] = (
                    mass_of_class / total_mass if total_mass > 0.0 else mass_of_class
                )
    share = np.zeros((len(row), modes))
    for index in range(len(row)):
        output = output_row[target_of[index]]
        for mode in range(modes if output >= 0 else 0):
            total_mass = of_class[target_of[index], majority[output]]
            if total_mass > 0.0:
                share[index, mode] = weight[row[index], mode, majority[output]] / total_mass
            add_mean(share[index, mode], mean[row[index], mode], state[output])
    for index in range(len(row)):
        for mode in range(modes):
            if share[index, mode] > 0.0:
                own_mean, own_covariance = mean[row[index], mode], covariance[row[index], mode]
                output = output_row[target_of[index]]
                add_spread(
                    share[index, mode], own_mean, own_covariance, state[output], spread[output]
                )
    is_sound, factor = True, np.empty((SIZE, SIZE))
    for output in range(count):
        for i in range(SIZE):
            for k in range(i):
                half = 0.5 * (spread[output, i, k] + spread[output, k, i])
                spread[output, i, k] = spread[output, k, i] = half
        is_sound = is_positive(spread[output], factor) and is_sound
    return is_sound, chosen, mass, probability, majority, state, spread


def extract(
    mixture: Mixture, dynamics: Dynamics, stamp_ns: int, lag: int, threshold: float
) -> Estimates:
    """Return the targets whose existence probability is above a threshold.

    A target's class is the one of largest weight. State and covariance are the moments of that
    class over all hypotheses and motion modes. The `track_id` of a target is its label plus one.
    """
    targets = mixture.sums.label, mixture.sums.target, np.arange(len(mixture)), mixture.gaussians
    return extract_targets(*targets, dynamics, stamp_ns, lag, threshold)


def extract_targets(
    label: IntArray,
    target: IntArray,
    row: IntArray,
    gaussians: Gaussians,
    dynamics: Dynamics,
    stamp_ns: int,
    lag: int,
    threshold: float,
) -> Estimates:
    """Return targets as `extract` does.

    Parameters
    ----------
    label : int array of shape (T,)
        A label may occur several times.
    target, row : int arrays of shape (H,)
        The target of each hypothesis, and its row in the Gaussians.
    gaussians : Gaussians
    """
    class_moments = _class_moments[gaussians.mean.shape[2]]
    columns = class_moments(threshold, len(label), target, row, gaussians)
    is_sound, chosen, mass, probability, class_id, state, covariance = columns
    if not is_sound:
        covariance, _ = floor_eigenvalues(covariance)
    return dynamics.nobody.changed(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=covariance,
        weight=mass,
        class_probability=probability,
        class_id=class_id,
        track_id=label[chosen] + 1,
        track_state=np.full(len(mass), CONFIRMED),
    )


@BySize
@compiled
def _most_probable(
    distance: float,
    label: Int1,
    class_id: Int1,
    state: Float2,
    covariance: Float3,
    mixture: Hypotheses,
) -> FloatArray:
    """Return the states of `most_probable_motion`, given the moments of the whole densities."""
    found: FloatArray = state.copy()
    weight = mixture.weight
    factor, own_factor, whitened = np.empty((SIZE, SIZE)), np.empty((SIZE, SIZE)), np.empty(SIZE)
    for output in range(len(label)):
        row, mode, largest = -1, -1, 0.0
        for index in range(len(mixture.row_label)):
            for own_mode in range(
                weight.shape[1] if mixture.row_label[index] == label[output] else 0
            ):
                if weight[index, own_mode, class_id[output]] > largest:
                    row, mode = index, own_mode
                    largest = weight[index, own_mode, class_id[output]]
        if row < 0:
            continue
        mean = mixture.mean[row, mode]
        factorise(mixture.covariance[row, mode], factor)
        twice = square_distance(factor, state[output], mean, whitened)
        if twice + divergence(covariance[output], factor, own_factor) > distance:
            for i in range(SIZE):
                found[output, i] = mean[i]
    return found


def most_probable_motion(
    estimates: Estimates, mixture: Mixture, unseen: BoolArray, distance: float
) -> Estimates:
    """Return estimates in which an unseen target has its most probable motion.

    The density of a target that no sensor has seen for long has several humps, those of straight
    flight and of turns, and its mean is in none of them: a mean over directions is a velocity that
    is too small. The state is then that of the hypothesis and motion of the largest weight, and the
    covariance is that of the whole density about this state.

    Parameters
    ----------
    unseen : bool array of shape (N,)
    distance : float
        The whole density is more than one hump if a reduction with this `Bounds.merge_distance`
        would not merge one of its moments with the most probable motion.
    """
    (rows,) = unseen.nonzero()
    label, class_id = estimates.track_id[rows] - 1, estimates.class_id[rows]
    mean, spread = estimates.state[rows], estimates.covariance[rows]
    found = _most_probable[mean.shape[1]](
        distance, label, class_id, mean, spread, mixture.hypotheses
    )
    away = mean - found
    state, covariance = estimates.state.copy(), estimates.covariance.copy()
    state[rows] = found
    covariance[rows] += away[:, :, None] * away[:, None]
    return estimates.changed(state=state, covariance=covariance)
