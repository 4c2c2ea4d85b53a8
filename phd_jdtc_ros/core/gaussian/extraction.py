"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float3, Float4, Int1, compiled
from ..types import Estimates
from .algebra import kalman
from .algebra.blocks import SIZE, add_mean, add_spread
from .algebra.vectors import add
from .dynamics import Dynamics
from .mixture import Mixture


@compiled
def _class_moments(
    target: Int1,
    targets: int,
    weight: Float3,
    mean: Float3,
    covariance: Float4,
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Return each target's mass by class, (T, C), its class, and the moments of that class."""
    count, modes, classes = weight.shape
    class_mass, majority = np.zeros((targets, classes)), np.zeros(targets, np.int64)
    state, spread = np.zeros((targets, SIZE)), np.zeros((targets, SIZE, SIZE))
    for row in range(count):
        for mode in range(modes):
            add(weight[row, mode], class_mass[target[row]])
    for one in range(targets):
        majority[one] = np.argmax(class_mass[one])
    share = np.zeros((count, modes))
    for row in range(count):
        own = majority[target[row]]
        whole = class_mass[target[row], own]
        for mode in range(modes):
            if whole > 0.0:
                share[row, mode] = weight[row, mode, own] / whole
            add_mean(share[row, mode], mean[row, mode], state[target[row]])
    for row in range(count):
        for mode in range(modes):
            if share[row, mode] > 0.0:
                at, around = state[target[row]], spread[target[row]]
                add_spread(share[row, mode], mean[row, mode], covariance[row, mode], at, around)
    return class_mass, majority, state, spread


def extract(
    mixture: Mixture, dynamics: Dynamics, stamp_ns: int, lag: int, threshold: float
) -> Estimates:
    """Return the targets whose existence probability is above a threshold.

    A target's class is the one of largest weight. State and covariance are the moments of that
    class over all hypotheses and motion modes. The `track_id` of a target is its label plus one.
    """
    targets = mixture.label, mixture.target, mixture.gaussians
    return extract_targets(*targets, dynamics, stamp_ns, lag, threshold)


def extract_targets(
    label: IntArray,
    target: IntArray,
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
    target : int array of shape (H,)
        The target of each hypothesis.
    gaussians : sequence of arrays
        See `Mixture.gaussians`.
    """
    class_mass, majority, state, covariance = _class_moments(target, len(label), *gaussians)
    mass = class_mass.sum(axis=1)
    rows = np.flatnonzero(mass > threshold)
    mass = mass[rows]
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state[rows],
        covariance=kalman.floor_eigenvalues(kalman.symmetric(covariance[rows]))[0],
        weight=mass,
        class_probability=class_mass[rows] / np.where(mass > 0.0, mass, 1.0)[:, None],
        class_id=majority[rows],
        track_id=label[rows] + 1,
        space=dynamics.model.modes.space,
    )
