"""Publication stamps, and prediction or interpolation of estimates to one common stamp.

A turning radar updates every target at a different time. Filtered estimates are predicted from
there to the common stamp; smoothed ones are interpolated between the updates before and after it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..arrays import FloatArray, IntArray
from ..state_space import StateSpace
from ..targets.modes import ModeSpace
from ..targets.motion import CoordinatedTurn
from ..types import Estimates

# Predicts the mean of a state; with a turn rate of zero along a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)
# Step of the numerical Jacobian along the axes of position and velocity.
STEP = 1e-2
# Step along the axis of the turn rate.
TURN_STEP = 1e-6


@dataclass(frozen=True)
class Schedule:
    """Stamps at which estimates are published."""

    period_ns: int  # Estimates are published at multiples of this; 0 for the stamp of every scan

    def between(self, after_ns: int, before_ns: int) -> list[int]:
        """Return the publication stamps from one scan's stamp to before the next one's, ascending.

        The earlier scan's stamp is included if it is a multiple of the period.
        """
        if not self.period_ns:
            return []
        first = -(-after_ns // self.period_ns) * self.period_ns
        return list(range(first, before_ns, self.period_ns))


def predict(estimates: Estimates, time_ns: IntArray, stamp_ns: int, modes: ModeSpace) -> Estimates:
    """Return the estimates at a later stamp, given the time of each, (N,).

    The mean follows its coordinated turn, and the covariance is predicted to first order. The
    process noise is the mean over the class's motion models.
    """
    (to_predict,) = (time_ns != stamp_ns).nonzero()
    if not to_predict.size:
        is_at_stamp = estimates.stamp_ns == stamp_ns
        return estimates if is_at_stamp else estimates.changed(stamp_ns=stamp_ns)
    dt = (stamp_ns - time_ns[to_predict]).astype(np.float64) * 1e-9
    class_of_track = estimates.class_id[to_predict]
    state, covariance = estimates.state[to_predict], estimates.covariance[to_predict]
    step, shift = _steps(estimates.space)
    predicted = NOISE_FREE.mean(shift[:, None] + state, dt)
    size = step.size
    difference = predicted[1 : size + 1] - predicted[size + 1 :]
    jacobian = (difference / (2.0 * step)[:, None, None]).transpose(1, 2, 0)
    by_mode, noise = modes.noise(dt), np.zeros(covariance.shape)
    for mode, class_id in enumerate(modes.class_of.tolist()):
        of_class = (class_of_track == class_id)[:, None, None]
        noise += of_class * by_mode[:, mode] / len(modes.classes[class_id].motions)
    survival = modes.nominal_survival[class_of_track] ** (dt / modes.interval_s)
    covariance = jacobian @ covariance @ jacobian.transpose(0, 2, 1) + noise
    return estimates.changed(
        stamp_ns=stamp_ns,
        state=_with_values(estimates.state, to_predict, predicted[0]),
        covariance=_with_values(estimates.covariance, to_predict, covariance),
        weight=_with_values(estimates.weight, to_predict, estimates.weight[to_predict] * survival),
    )


@cache
def _steps(space: StateSpace) -> tuple[FloatArray, FloatArray]:
    """Return the step along each axis, (D,), and the shifts of a state, (1 + 2 D, D).

    The first shift is zero; then follow the steps up along each axis, and then those down.
    """
    step = np.full(len(space), STEP)
    step[space.turn_rate] = TURN_STEP
    shift = np.diag(step)
    return step, np.concatenate([np.zeros((1, len(space))), shift, -shift])


def _with_values(column: FloatArray, rows: IntArray, values: FloatArray) -> FloatArray:
    """Return a copy of a column with other values in these rows."""
    changed: FloatArray = column.copy()
    changed[rows] = values
    return changed


def interpolate(
    before: Estimates, after: Estimates, between_ns: tuple[IntArray, IntArray], stamp_ns: int
) -> Estimates:
    """Return the estimates at a stamp between two others; tracks must match row by row.

    `between_ns` has the times of both, row by row.

    Positions follow the cubic Hermite spline of the positions and velocities at both ends.
    Everything else is linear in time.
    """
    duration_s = ((between_ns[1] - between_ns[0]) * 1e-9)[:, None]
    s = (stamp_ns - between_ns[0])[:, None] * 1e-9 / duration_s
    state = (1.0 - s) * before.state + s * after.state
    position, velocity = list(before.space.position), list(before.space.velocity)
    p0, p1 = before.state[:, position], after.state[:, position]
    v0, v1 = duration_s * before.state[:, velocity], duration_s * after.state[:, velocity]
    state[:, position] = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * p0
        + s * (1.0 - s) ** 2 * v0
        + s**2 * (3.0 - 2.0 * s) * p1
        + s**2 * (s - 1.0) * v1
    )
    state[:, velocity] = (
        6.0 * s * (1.0 - s) * (p1 - p0)
        + (1.0 - s) * (1.0 - 3.0 * s) * v0
        + s * (3.0 * s - 2.0) * v1
    ) / duration_s

    def linear(first: FloatArray, second: FloatArray) -> FloatArray:
        fraction = s.reshape(-1, *[1] * (first.ndim - 1))
        return (1.0 - fraction) * first + fraction * second

    probability = linear(before.class_probability, after.class_probability)
    return before.changed(
        stamp_ns=stamp_ns,
        state=state,
        covariance=linear(before.covariance, after.covariance),
        weight=linear(before.weight, after.weight),
        class_probability=probability,
        class_id=probability.argmax(axis=1),
    )


def at_stamp(
    estimates: Estimates, time_ns: IntArray, stamp_ns: int, threshold: float, modes: ModeSpace
) -> Estimates:
    """Return the targets at a stamp, given estimates at the times of their updates.

    The estimates include unreported targets, and a target may have several, at different times. It
    is interpolated between its last update up to the stamp and its first update after it, or
    predicted without a later one, and is reported if its existence probability is above the
    threshold.
    """
    order = np.lexsort((time_ns, estimates.track_id))
    order = order[estimates.track_id[order] != 0]
    track, past = estimates.track_id[order], time_ns[order] <= stamp_ns
    last = np.flatnonzero(
        past & np.append((track[1:] != track[:-1]) | ~past[1:], True)[: len(past)]
    )
    row = order[last]
    following = np.minimum(last + 1, len(order) - 1)
    has_later = (last + 1 < len(order)) & (track[following] == track[last])
    before, alone = row[has_later], row[~has_later]
    after = order[following[has_later]]
    # Estimates without labels cannot be followed: those of the last scan are used.
    unlabelled = (estimates.track_id == 0) & (time_ns <= stamp_ns)
    latest = time_ns[unlabelled].max(initial=0)
    alone = np.append(alone, np.flatnonzero(unlabelled & (time_ns == latest)))
    return between(estimates, time_ns, before, after, alone, stamp_ns, threshold, modes)


def between(
    estimates: Estimates,
    time_ns: IntArray,
    before: IntArray | slice,
    after: IntArray | slice,
    alone: IntArray | slice,
    stamp_ns: int,
    threshold: float,
    modes: ModeSpace,
) -> Estimates:
    """Return the targets at a stamp: interpolated, or predicted if they have no later estimate.

    `before` and `after` are the rows to interpolate between, in the same order of targets. `alone`
    are the rows to predict. All three are ascending.
    """
    parts = []
    if len(time_ns[alone]):
        parts.append(predict(estimates.take(alone), time_ns[alone], stamp_ns, modes))
    if len(time_ns[before]) or not parts:
        ends = estimates.take(before), estimates.take(after)
        parts.append(interpolate(*ends, (time_ns[before], time_ns[after]), stamp_ns))
    targets, _ = Estimates.concatenate(parts, estimates.lag)
    return targets.select(targets.weight > threshold)
