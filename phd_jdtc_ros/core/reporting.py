# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""When estimates go out, and how targets that were updated at different times get one stamp.

A radar that turns updates every target at a time of its own. Filtered estimates are predicted from
there to the common stamp, and smoothed ones are interpolated between the times before and after.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .arrays import FloatArray, IntArray
from .models.modes import ModeSpace
from .models.motion import CoordinatedTurn
from .types import Estimates

# The mean of a target's next state; with a turn rate of zero it is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)
# Steps of the numerical Jacobian along the axes of position and velocity, and of the turn rate.
STEP, TURN_STEP = 1e-2, 1e-6


@dataclass(frozen=True)
class Schedule:
    """When estimates go out.

    Parameters
    ----------
    period_ns : int
        At stamps that are multiples of this; 0 for the stamp of every scan.
    """

    period_ns: int

    def between(self, after_ns: int, before_ns: int) -> list[int]:
        """Return the stamps of estimates after one stamp and before another, ascending."""
        if not self.period_ns:
            return []
        first = (after_ns // self.period_ns + 1) * self.period_ns
        return list(range(first, before_ns, self.period_ns))


def joined(parts: Sequence[Estimates], stamp_ns: int, lag: int) -> Estimates:
    """Return estimates of one stamp as one, by ascending track; there must be one part at least."""
    order = np.argsort(np.concatenate([part.track_id for part in parts]), kind="stable")

    def column(name: str) -> FloatArray:
        joint: FloatArray = np.concatenate([getattr(part, name) for part in parts])[order]
        return joint

    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=column("state"),
        covariance=column("covariance"),
        weight=column("weight"),
        class_probability=column("class_probability"),
        class_id=column("class_id").astype(np.int64),
        track_id=column("track_id").astype(np.int64),
        track_state=column("track_state").astype(np.int64),
        space=parts[0].space,
    )


def chosen(estimates: Estimates, rows: IntArray) -> Estimates:
    """Return the estimates of these rows."""
    return replace(
        estimates,
        state=estimates.state[rows],
        covariance=estimates.covariance[rows],
        weight=estimates.weight[rows],
        class_probability=estimates.class_probability[rows],
        class_id=estimates.class_id[rows],
        track_id=estimates.track_id[rows],
        track_state=estimates.track_state[rows],
    )


def predicted(estimates: Estimates, stamp_ns: int, modes: ModeSpace) -> Estimates:
    """Return the estimates at a later stamp.

    Notes
    -----
    The mean moves along its turn, and the covariance to first order of it. The process noise is the
    mean of those of the class's motions.
    """
    dt = (stamp_ns - estimates.stamp_ns) * 1e-9
    if dt == 0.0 or not len(estimates):
        return replace(estimates, stamp_ns=stamp_ns)
    state = estimates.state
    size = state.shape[1]
    step = np.full(size, STEP)
    step[estimates.space.turn_rate] = TURN_STEP
    columns = [
        (NOISE_FREE.mean(state + shift, dt) - NOISE_FREE.mean(state - shift, dt)) / (2.0 * width)
        for shift, width in zip(np.diag(step), step, strict=True)
    ]
    jacobian = np.stack(columns, axis=2)
    noise = np.zeros((len(modes.classes), size, size))
    for index, model in enumerate(modes.classes):
        for motion in model.motions:
            axes = np.ix_(motion.support, motion.support)
            noise[index][axes] += motion.noise_covariance(dt) / len(model.motions)
    first_mode = np.searchsorted(modes.class_of, np.arange(len(modes.classes)))
    return replace(
        estimates,
        stamp_ns=stamp_ns,
        state=NOISE_FREE.mean(state, dt),
        covariance=jacobian @ estimates.covariance @ jacobian.transpose(0, 2, 1)
        + noise[estimates.class_id],
        weight=estimates.weight * modes.survival(dt)[first_mode][estimates.class_id],
    )


def interpolated(before: Estimates, after: Estimates, stamp_ns: int) -> Estimates:
    """Return the estimates at a stamp between two others; tracks must match row by row.

    Notes
    -----
    Positions follow the cubic with the positions and velocities at both ends. Everything else is
    linear in time.
    """
    length = (after.stamp_ns - before.stamp_ns) * 1e-9
    s = (stamp_ns - before.stamp_ns) * 1e-9 / length
    state = (1.0 - s) * before.state + s * after.state
    place, speed = list(before.space.position), list(before.space.velocity)
    p0, p1 = before.state[:, place], after.state[:, place]
    v0, v1 = length * before.state[:, speed], length * after.state[:, speed]
    state[:, place] = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * p0
        + s * (1.0 - s) ** 2 * v0
        + s**2 * (3.0 - 2.0 * s) * p1
        + s**2 * (s - 1.0) * v1
    )
    state[:, speed] = (
        6.0 * s * (1.0 - s) * (p1 - p0)
        + (1.0 - s) * (1.0 - 3.0 * s) * v0
        + s * (3.0 * s - 2.0) * v1
    ) / length

    def linear(name: str) -> FloatArray:
        between: FloatArray = (1.0 - s) * getattr(before, name) + s * getattr(after, name)
        return between

    return replace(
        before,
        stamp_ns=stamp_ns,
        state=state,
        covariance=linear("covariance"),
        weight=linear("weight"),
        class_probability=linear("class_probability"),
        class_id=linear("class_probability").argmax(axis=1),
    )


def at_stamp(
    parts: Sequence[Estimates], stamp_ns: int, lag: int, threshold: float, modes: ModeSpace
) -> Estimates:
    """Return the targets at a stamp, given them at the times at which they were updated.

    Parameters
    ----------
    parts : sequence of Estimates
        By ascending stamp, also of targets that are not reported. A target may be in several.
    stamp_ns : int
    lag : int
    threshold : float
        Existence probability above which a target is reported.
    modes : ModeSpace

    Notes
    -----
    A target is interpolated between its last update until the stamp and its first one after it. If
    there is none after it, it is predicted.
    """
    split = sum(part.stamp_ns <= stamp_ns for part in parts)
    latest = _one_each(range(split - 1, -1, -1), parts)
    upcoming = _one_each(range(split, len(parts)), parts)
    pairs: dict[tuple[int, int | None], list[tuple[int, int]]] = {}
    for track, (part, row) in latest.items():
        later, later_row = upcoming.get(track, (None, 0))
        pairs.setdefault((part, later), []).append((row, later_row))
    found = []
    for (part, later), rows in pairs.items():
        here, there = np.array(rows, dtype=np.int64).T
        before = chosen(parts[part], here)
        if later is None:
            found.append(predicted(before, stamp_ns, modes))
        else:
            found.append(interpolated(before, chosen(parts[later], there), stamp_ns))
    if split:  # what no label follows is only known from the last scan
        unlabelled = np.flatnonzero(parts[split - 1].track_id == 0)
        found.append(predicted(chosen(parts[split - 1], unlabelled), stamp_ns, modes))
    if not found:
        return _none(modes, stamp_ns, lag)
    whole = joined(found, stamp_ns, lag)
    return chosen(whole, np.flatnonzero(whole.weight > threshold))


def _one_each(order: Iterable[int], parts: Sequence[Estimates]) -> dict[int, tuple[int, int]]:
    """Return the first part, in this order, that holds each labelled track, and its row there."""
    found: dict[int, tuple[int, int]] = {}
    for index in order:
        for row, track in enumerate(parts[index].track_id.tolist()):
            if track:
                found.setdefault(track, (index, row))
    return found


def _none(modes: ModeSpace, stamp_ns: int, lag: int) -> Estimates:
    size, none = len(modes.space), np.zeros(0, dtype=np.int64)
    return Estimates(
        stamp_ns=stamp_ns,
        lag=lag,
        state=np.zeros((0, size)),
        covariance=np.zeros((0, size, size)),
        weight=np.zeros(0),
        class_probability=np.zeros((0, len(modes.classes))),
        class_id=none,
        track_id=none,
        space=modes.space,
    )
