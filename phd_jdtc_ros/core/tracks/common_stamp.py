"""Publication stamps, and prediction or interpolation of estimates to one common stamp.

A turning radar updates every target at a different time. Filtered estimates are predicted from
there to the common stamp; smoothed ones are interpolated between the updates before and after it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, read_only
from ..compilation import Float1, Float2, Float3, Int1, compiled, inner
from ..state_space import SPATIAL
from ..targets.modes import ModeSpace
from ..targets.turn_matrix import climb, turn, turn_terms
from ..types import Estimates

OMEGA, VZ = SPATIAL.turn_rate, SPATIAL.vertical[1]
# Axes of a position and its velocity.
MOVING = tuple(zip(SPATIAL.place, SPATIAL.motion, strict=True))
# Step of the numerical Jacobian along the axes of position and velocity.
STEP = 1e-2


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
    return of the turn rate and the process noise are means over the class's motion models.
    """
    (to_predict,) = (time_ns != stamp_ns).nonzero()
    if not to_predict.size:
        is_at_stamp = estimates.stamp_ns == stamp_ns
        return estimates if is_at_stamp else estimates.changed(stamp_ns=stamp_ns)
    dt = (stamp_ns - time_ns[to_predict]).astype(np.float64) * 1e-9
    class_id, covariance = estimates.class_id[to_predict], estimates.covariance[to_predict]
    own = modes.class_of == class_id[:, None]
    share = own / own.sum(axis=1, keepdims=True)
    arc = np.einsum("no,noi->ni", share, modes.arc(dt))
    noise = np.einsum("no,noik->nik", share, modes.noise(dt))
    state, columns = _predicted(estimates.state[to_predict], arc)
    jacobian = columns.transpose(1, 2, 0)
    survival = modes.nominal_survival[class_id] ** (dt / modes.interval_s)
    covariance = jacobian @ covariance @ jacobian.transpose(0, 2, 1) + noise
    return estimates.changed(
        stamp_ns=stamp_ns,
        state=_with_values(estimates.state, to_predict, state),
        covariance=_with_values(estimates.covariance, to_predict, covariance),
        weight=_with_values(estimates.weight, to_predict, estimates.weight[to_predict] * survival),
    )


@inner
def _move(arc: FloatArray, state: FloatArray, later: FloatArray) -> None:
    """Write a state after its `motion.turn_arc`."""
    turn(turn_terms(state[OMEGA], arc), state, later)
    if len(state) > VZ:
        climb(arc[1] + arc[2], state, later)


@compiled
def _predicted(state: Float2, arc: Float2) -> tuple[FloatArray, FloatArray]:
    """Return states after their `motion.turn_arc`, (N, D), and their numerical Jacobians by column.

    The Jacobians' shape is (D, N, D).
    """
    count, size = state.shape
    later, columns = np.empty((count, size)), np.empty((size, count, size))
    shifted, ends = np.empty(size), np.empty((2, size))
    for row in range(count):
        _move(arc[row], state[row], later[row])
        for axis in range(size):
            # Step along the axis of the turn rate.
            turn_step = 1e-6
            step = turn_step if axis == OMEGA else STEP
            for side in range(2):
                for i in range(size):
                    shifted[i] = state[row, i]
                shifted[axis] += step if side else -step
                _move(arc[row], shifted, ends[side])
            for i in range(size):
                columns[axis, row, i] = (ends[1, i] - ends[0, i]) / (2.0 * step)
    return later, columns


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
    begin, end = (
        _Columns(
            *map(read_only, (each.state, each.covariance, each.weight, each.class_probability))
        )
        for each in (before, after)
    )
    state, covariance, weight, probability = _interpolated(stamp_ns, *between_ns, begin, end)
    return before.changed(
        stamp_ns=stamp_ns,
        state=state,
        covariance=covariance,
        weight=weight,
        class_probability=probability,
        class_id=probability.argmax(axis=1),
    )


class _Columns(NamedTuple):
    """N estimates; see `Estimates`."""

    state: Float2
    covariance: Float3
    weight: Float1
    class_probability: Float2


@compiled
def _interpolated(
    stamp_ns: int, begin_ns: Int1, end_ns: Int1, begin: _Columns, end: _Columns
) -> _Columns:
    """Return the estimates between two others."""
    state0, covariance0, weight0, probability0 = begin
    state1, covariance1, weight1, probability1 = end
    state, covariance = np.empty_like(state0), np.empty_like(covariance0)
    weight, probability = np.empty_like(weight0), np.empty_like(probability0)
    for row in range(len(state)):
        duration_s = (end_ns[row] - begin_ns[row]) * 1e-9
        s = (stamp_ns - begin_ns[row]) * 1e-9 / duration_s
        r = 1.0 - s
        for i in range(state.shape[1]):
            state[row, i] = r * state0[row, i] + s * state1[row, i]
            for k in range(state.shape[1]):
                covariance[row, i, k] = r * covariance0[row, i, k] + s * covariance1[row, i, k]
        for x, vx in MOVING:
            if vx >= state.shape[1]:
                continue
            p0, p1 = state0[row, x], state1[row, x]
            v0, v1 = duration_s * state0[row, vx], duration_s * state1[row, vx]
            state[row, x] = (1.0 + 2.0 * s) * (r * r) * p0 + s * (r * r) * v0
            state[row, x] += s * s * (3.0 - 2.0 * s) * p1
            state[row, x] += s * s * (s - 1.0) * v1
            moved = 6.0 * s * r * (p1 - p0) + r * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
            state[row, vx] = moved / duration_s
        weight[row] = r * weight0[row] + s * weight1[row]
        for class_id in range(probability.shape[1]):
            linear = r * probability0[row, class_id] + s * probability1[row, class_id]
            probability[row, class_id] = linear
    return _Columns(state, covariance, weight, probability)


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
