"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float3, Float4, Int1, compiled
from ..types import Estimates
from .algebra import kalman
from .algebra.blocks import SIZE, add_mean, add_spread
from .algebra.vectors import add, total_of
from .dynamics import Dynamics
from .mixture import Mixture


@compiled
def _class_moments(
    threshold: float,
    targets: int,
    target: Int1,
    row: Int1,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
) -> tuple[IntArray, FloatArray, FloatArray, IntArray, FloatArray, FloatArray]:
    """Return the targets whose mass is above a threshold, and the columns of their estimates.

    These are the mass, the probability of each class, the most probable class, and the moments of
    that class. `target` and `row` have the target of each hypothesis, and its row in the Gaussians.
    """
    modes, classes = weight.shape[1:]
    of_class, kept, found = np.zeros((targets, classes)), np.full(targets, -1), 0
    for at in range(len(row)):
        for mode in range(modes):
            add(weight[row[at], mode], of_class[target[at]])
    for one in range(targets):
        if total_of(of_class[one]) > threshold:
            kept[one] = found
            found += 1
    which, mass, majority = np.empty(found, np.int64), np.empty(found), np.empty(found, np.int64)
    probability = np.empty((found, classes))
    state, spread = np.zeros((found, SIZE)), np.zeros((found, SIZE, SIZE))
    for one in range(targets):
        if kept[one] >= 0:
            place, whole = kept[one], total_of(of_class[one])
            which[place], mass[place] = one, whole
            majority[place] = 0
            for class_id in range(classes):
                own = of_class[one, class_id]
                if own > of_class[one, majority[place]]:
                    majority[place] = class_id
                probability[place, class_id] = own / whole if whole > 0.0 else own
    share = np.zeros((len(row), modes))
    for at in range(len(row)):
        place = kept[target[at]]
        for mode in range(modes if place >= 0 else 0):
            whole = of_class[target[at], majority[place]]
            if whole > 0.0:
                share[at, mode] = weight[row[at], mode, majority[place]] / whole
            add_mean(share[at, mode], mean[row[at], mode], state[place])
    for at in range(len(row)):
        for mode in range(modes):
            if share[at, mode] > 0.0:
                own, around = mean[row[at], mode], covariance[row[at], mode]
                place = kept[target[at]]
                add_spread(share[at, mode], own, around, state[place], spread[place])
    for place in range(found):
        for i in range(SIZE):
            for k in range(i):
                half = 0.5 * (spread[place, i, k] + spread[place, k, i])
                spread[place, i, k] = spread[place, k, i] = half
    return which, mass, probability, majority, state, spread


def extract(
    mixture: Mixture, dynamics: Dynamics, stamp_ns: int, lag: int, threshold: float
) -> Estimates:
    """Return the targets whose existence probability is above a threshold.

    A target's class is the one of largest weight. State and covariance are the moments of that
    class over all hypotheses and motion modes. The `track_id` of a target is its label plus one.
    """
    targets = mixture.label, mixture.target, np.arange(len(mixture)), mixture.gaussians
    return extract_targets(*targets, dynamics, stamp_ns, lag, threshold)


def extract_targets(
    label: IntArray,
    target: IntArray,
    row: IntArray,
    gaussians: Sequence[FloatArray],
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
    gaussians : sequence of arrays
        See `Mixture.gaussians`.
    """
    found = _class_moments(threshold, len(label), target, row, *gaussians)
    which, mass, probability, class_id, state, covariance = found
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=kalman.floor_eigenvalues(covariance)[0],
        weight=mass,
        class_probability=probability,
        class_id=class_id,
        track_id=label[which] + 1,
        space=dynamics.model.modes.space,
    )
