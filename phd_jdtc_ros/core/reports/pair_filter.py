"""The filter of a pair: the state of a track with the antenna's place, by plots and reports.

The log weight of a pair is that of "the source reports this track, and rightly" against "it does
not". A report has the velocity too, and may be older than the state.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from ..compilation import Writeable, compiled, inner
from .batches import Batch, Tables
from .filters import Link, State, link_back, observe, predict
from .model import Reliability
from .tables import Pairs

# Slower transmitters have no course, metres per second.
STEERABLE = 0.3
# Standard deviation of an antenna's place ahead from which it tells whether the ship says it
# rightly, metres, and the square distance within which she does.
KNOWN_ANTENNA, FITTING = 20.0, 4.0
# Bounds of log weights: no evidence is stronger.
MOST_WEIGHT = 30.0


@inner
def turned(log_weight: float, rules: Reliability) -> float:
    """Return a log weight after a report: honest sources may turn wrong, and wrong ones right."""
    bounded = min(max(log_weight, -MOST_WEIGHT), MOST_WEIGHT)
    p = 1.0 / (1.0 + math.exp(-bounded))
    p = (1.0 - rules.turns_wrong) * p + rules.turns_right * (1.0 - p)
    return math.log(p / (1.0 - p))


@inner
def write_matrix(matrix: FloatArray, ahead: FloatArray, late_s: float) -> None:
    """Write the measurement of a pair's report: place with the offset, and velocity.

    `late_s` is the time from the report to the state, seconds; 0 if the state is the report's.
    """
    for i in range(4):
        for k in range(matrix.shape[1]):
            matrix[i, k] = 0.0
        matrix[i, i] = 1.0
    matrix[0, 2] = matrix[1, 3] = -late_s
    if matrix.shape[1] > 4:
        matrix[0, 4] = matrix[1, 5] = ahead[0]
        matrix[0, 5], matrix[1, 4] = -ahead[1], ahead[1]


@inner
def write_noise(noise: FloatArray, own: FloatArray, late_s: float, density: float) -> None:
    """Write the noise of a report that is late: what the state may have done since is added."""
    for i in range(4):
        for k in range(4):
            noise[i, k] = own[i, k]
    for i in range(2):
        noise[i, i] += density * late_s**3 / 3.0
        noise[i, i + 2] -= density * late_s**2 / 2.0
        noise[i + 2, i] -= density * late_s**2 / 2.0
        noise[i + 2, i + 2] += density * late_s


@compiled
def advance(pairs: Writeable[Pairs], row: int, time_ns: int, density: float) -> None:
    """Predict a pair to a later time, with its link back."""
    dt = (time_ns - pairs.time_ns[row]) * 1e-9
    before = State(pairs.mean[row].copy(), pairs.covariance[row].copy())
    predict(State(pairs.mean[row], pairs.covariance[row]), dt, density)
    after = State(pairs.mean[row].copy(), pairs.covariance[row].copy())
    link_back(before, after, dt, Link(pairs.shift[row], pairs.gain[row], pairs.rest[row]))
    pairs.time_ns[row] = time_ns


@compiled
def write_pair(
    pairs: Writeable[Pairs], row: int, source: int, label: int, time_ns: int, offset_std: float
) -> None:
    """Write a pair that begins now into a row, without its position and velocity."""
    pairs.source[row], pairs.label[row] = source, label
    pairs.time_ns[row] = pairs.since_ns[row] = time_ns
    pairs.owned[row] = 0.0
    pairs.certain[row] = pairs.heard_ns[row] = 0
    for i in range(6):
        pairs.mean[row, i] = pairs.shift[row, i] = 0.0
        for k in range(6):
            pairs.covariance[row, i, k] = pairs.rest[row, i, k] = 0.0
            pairs.gain[row, i, k] = 1.0 if i == k else 0.0
    pairs.covariance[row, 4, 4] = offset_std**2
    pairs.covariance[row, 5, 5] = (offset_std / 5.0) ** 2


@inner
def _narrow(state: State, antenna: FloatArray) -> None:
    """Update the antenna's place with what the ship says of it, in place.

    Some ships say it wrongly, so that it counts only where it fits what is known already.
    """
    variance, known = antenna[2] ** 2, state.covariance[4, 4]
    if antenna[2] == 0.0 or not variance < known < KNOWN_ANTENNA**2:
        return
    square = 0.0
    for i in range(2):
        square += (state.mean[4 + i] - antenna[i]) ** 2 / (
            state.covariance[4 + i, 4 + i] + variance
        )
    if square > FITTING:
        return
    matrix, noise = np.zeros((2, 6)), np.zeros((2, 2))
    for i in range(2):
        matrix[i, 4 + i], noise[i, i] = 1.0, variance
    observe(state, antenna[:2], matrix, noise, 2)


@compiled
def update_pairs(
    batch: Batch,
    report: int,
    source: int,
    log_ghost: float,
    rules: Reliability,
    tables: Writeable[Tables],
) -> None:
    """Update the filters and the weights of a source's pairs with its report, in place."""
    sources, pairs, chains = tables
    matrix, noise, ahead = np.zeros((4, 6)), np.empty((4, 4)), np.empty(2)
    time_ns, size = batch.time_ns[report], batch.components[report]
    for slot in range(chains.pairs.shape[1]):
        row = chains.pairs[source, slot]
        if row < 0:
            continue
        if pairs.time_ns[row] < time_ns:
            advance(pairs, row, time_ns, rules.noise_density)
        late_s = (pairs.time_ns[row] - time_ns) * 1e-9
        ahead[0], ahead[1] = sources.ahead[source, 0], sources.ahead[source, 1]
        speed = math.hypot(pairs.mean[row, 2], pairs.mean[row, 3])
        if ahead[0] == 0.0 and ahead[1] == 0.0 and speed > STEERABLE:
            ahead[0], ahead[1] = pairs.mean[row, 2] / speed, pairs.mean[row, 3] / speed
        write_matrix(matrix, ahead, late_s)
        write_noise(noise, batch.noise[report], late_s, rules.noise_density)
        state = State(pairs.mean[row], pairs.covariance[row])
        log_likelihood, _ = observe(state, batch.measured[report], matrix, noise, size)
        _narrow(state, batch.antenna[report])
        pairs.log_weight[row] = turned(pairs.log_weight[row] + log_likelihood - log_ghost, rules)
        pairs.heard_ns[row] = max(pairs.heard_ns[row], time_ns)
