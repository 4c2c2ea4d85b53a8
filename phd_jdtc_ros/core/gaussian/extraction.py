# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

import numpy as np

from ..arrays import sum_by
from ..types import Estimates
from . import kalman
from .dynamics import Dynamics
from .mixture import Mixture


def extracted(
    mixture: Mixture, dynamics: Dynamics, stamp_ns: int, lag: int, threshold: float
) -> Estimates:
    """Return the targets whose existence probability is above a threshold.

    The class is that of the largest weight. The state and covariance are those of that class, over
    all hypotheses and motion modes. The `track_id` of a target is its origin plus one.
    """
    reported = np.flatnonzero(mixture.existence > threshold)
    rows = np.flatnonzero(np.isin(mixture.target, reported))
    mixture = mixture.take(rows)
    space, cells = dynamics.model.modes.space, dynamics.cells
    count, classes = len(mixture.label), len(dynamics.model.modes.classes)
    weight = mixture.weight.sum(axis=1)
    class_mass = np.stack(
        [
            sum_by(mixture.target, weight[:, cells.class_of == index].sum(axis=1), count)
            for index in range(classes)
        ],
        axis=1,
    )
    majority = class_mass.argmax(axis=1) if count else np.zeros(0, dtype=np.int64)
    mass = class_mass.sum(axis=1)
    own = cells.class_of == majority[mixture.target][:, None]
    own_weight = (mixture.weight * own[:, None]).sum(axis=2)
    total = class_mass[np.arange(count), majority]
    share = own_weight / np.where(total > 0.0, total, 1.0)[mixture.target][:, None]
    state, covariance = mixture.matched(share)
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=kalman.floored(kalman.symmetric(covariance))[0],
        weight=mass,
        class_probability=class_mass / np.where(mass > 0.0, mass, 1.0)[:, None],
        class_id=majority,
        track_id=mixture.label + 1,
        space=space,
    )
