"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float3, Float4, Int1, compiled
from ..types import Estimates
from ..window.fixed_lag import Part
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
    class_mass, majority, state, covariance = _class_moments(
        mixture.target, len(mixture.label), *mixture.gaussians
    )
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
        track_id=mixture.label[rows] + 1,
        space=dynamics.model.modes.space,
    )


def extract_all(
    parts: Sequence[Part[Mixture]], dynamics: Dynamics, lag: int
) -> tuple[Estimates, IntArray]:
    """Return the targets of several mixtures at any existence probability, and each one's time.

    One call handles all mixtures, because a turning radar leaves a few targets in each of many.
    """
    stored = [part.stored for part in parts]
    sizes = np.array([len(mixture) for mixture in stored])
    labels = np.array([len(mixture.label) for mixture in stored])
    first = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.concatenate(
        [
            begin + (np.arange(len(part.stored)) if part.rows is None else part.rows)
            for begin, part in zip(first.tolist(), parts, strict=False)
        ]
    )
    # A target that occurs in several mixtures gets several rows.
    place = np.concatenate([mixture.target for mixture in stored])
    place += (np.cumsum(labels) - labels).repeat(sizes)
    whole = replace(Mixture.concatenate(stored), row_label=place).take(rows)
    found = extract(whole, dynamics, parts[-1].stamp_ns, lag, 0.0)
    at = found.track_id - 1
    origin = np.concatenate([mixture.label for mixture in stored])
    time_ns = np.array([part.stamp_ns for part in parts]).repeat(labels)
    return replace(found, track_id=origin[at] + 1), time_ns[at]
