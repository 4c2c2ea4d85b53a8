"""Extraction: every target that exists is reported with the mean of its most probable class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import IntArray, sum_by
from ..types import Estimates
from ..window.fixed_lag import Part
from .algebra import kalman
from .dynamics import Dynamics
from .mixture import Mixture


def extract(
    mixture: Mixture, dynamics: Dynamics, stamp_ns: int, lag: int, threshold: float
) -> Estimates:
    """Return the targets whose existence probability is above a threshold.

    A target's class is the one of largest weight. State and covariance are the moments of that
    class over all hypotheses and motion modes. The `track_id` of a target is its label plus one.
    """
    reported = mixture.existence > threshold
    if not reported.all():
        mixture = mixture.take(np.flatnonzero(reported[mixture.target]))
    space, cells = dynamics.model.modes.space, dynamics.cells
    count = len(mixture.label)
    by_class = np.einsum("hrs->hs", mixture.weight) @ dynamics.of_class
    class_mass = np.stack(
        [sum_by(mixture.target, weight, count) for weight in by_class.T.copy()], axis=1
    )
    majority = class_mass.argmax(axis=1) if count else np.zeros(0, dtype=np.int64)
    mass = class_mass.sum(axis=1)
    own = cells.class_of == majority[mixture.target][:, None]
    own_weight = np.einsum("hrs,hs->hr", mixture.weight, own.astype(np.float64))
    total = class_mass[np.arange(count), majority]
    share = own_weight / np.where(total > 0.0, total, 1.0)[mixture.target][:, None]
    state, covariance = mixture.moments(share)
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=state,
        covariance=kalman.floor_eigenvalues(kalman.symmetric(covariance))[0],
        weight=mass,
        class_probability=class_mass / np.where(mass > 0.0, mass, 1.0)[:, None],
        class_id=majority,
        track_id=mixture.label + 1,
        space=space,
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
