"""Compiled Kalman filters of one radar's plots, which link them to tracks and weigh a noise.

`link` links plots batch by batch, see `tracks`. `filter_tracks` is an IMM filter that gives the
likelihood of a noise, given tracks, see `noise`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.compilation import (
    Float1,
    Float2,
    Float3,
    Float4,
    Int1,
    Writeable,
    compiled,
    inner,
)
from phd_jdtc_ros.core.sensors.of_gaussians.angles import wrapped
from phd_jdtc_ros.core.sensors.polar_geometry import MIN_RANGE

# Errors of range and azimuth or of x and y, and the squared Mahalanobis distance and the
# determinant of the covariance of both.
Innovation = tuple[float, float, float, float]


@inner
def copy(
    mean: FloatArray, covariance: FloatArray, to_mean: FloatArray, to_covariance: FloatArray
) -> None:
    """Copy a Gaussian; an assignment of arrays would take seconds to compile."""
    for i in range(4):
        to_mean[i] = mean[i]
        for k in range(4):
            to_covariance[i, k] = covariance[i, k]


@inner
def predict(mean: FloatArray, covariance: FloatArray, dt: float, density: float) -> None:
    """Predict a Gaussian; `density` is that of the white acceleration, m^2/s^3."""
    for i in range(2):
        mean[i] += dt * mean[i + 2]
        for k in range(2):
            cross = covariance[i, k + 2] + covariance[k, i + 2]
            covariance[i, k] += dt * (cross + dt * covariance[i + 2, k + 2])
        covariance[i, i] += density * dt * dt * dt / 3.0
    for i in range(2):
        for k in range(2):
            covariance[i, k + 2] += dt * covariance[i + 2, k + 2]
        covariance[i, i + 2] += density * dt * dt / 2.0
        covariance[i + 2, i + 2] += density * dt
        covariance[2, i], covariance[3, i] = covariance[i, 2], covariance[i, 3]


@inner
def innovate(
    mean: FloatArray,
    covariance: FloatArray,
    measured: FloatArray,
    pose: FloatArray,
    variance: FloatArray,
    places: bool,
    step: FloatArray,
) -> Innovation:
    """Return a plot's innovation; `variance` is that of range and azimuth, or of x and y.

    Write its covariance with the state, and the gain: both are (2, 4).
    """
    cross, gain = step[0], step[1]
    east, north = mean[0] - pose[0], mean[1] - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    ahead, left = cos * east + sin * north, cos * north - sin * east
    distance = max(math.sqrt(ahead * ahead + left * left), MIN_RANGE)
    along, across = east / distance, north / distance
    range_error, azimuth_error = measured[0] - distance, 0.0
    if places:  # The rows of the Jacobian are the sensor's axes, as at a range of 1.
        distance, along, across = 1.0, cos, sin
        range_error, azimuth_error = measured[0] - ahead, measured[1] - left
    else:
        azimuth_error = wrapped(measured[1] - math.atan2(left, ahead))
    for i in range(4):
        cross[0, i] = covariance[i, 0] * along + covariance[i, 1] * across
        cross[1, i] = (covariance[i, 1] * along - covariance[i, 0] * across) / distance
    a = along * cross[0, 0] + across * cross[0, 1] + variance[0]
    b = along * cross[1, 0] + across * cross[1, 1]
    d = (along * cross[1, 1] - across * cross[1, 0]) / distance + variance[1]
    determinant = a * d - b * b
    for i in range(4):
        gain[0, i] = (d * cross[0, i] - b * cross[1, i]) / determinant
        gain[1, i] = (a * cross[1, i] - b * cross[0, i]) / determinant
    square = d * range_error * range_error + a * azimuth_error * azimuth_error
    square = (square - 2.0 * b * range_error * azimuth_error) / determinant
    return range_error, azimuth_error, square, determinant


@inner
def update(
    probability: float,
    found: Innovation,
    step: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Update a Gaussian by an innovation that is of the target with a probability."""
    cross, gain = step[0], step[1]
    for i in range(4):
        mean[i] += probability * (gain[0, i] * found[0] + gain[1, i] * found[1])
        for k in range(i + 1):
            reduction = gain[0, i] * cross[0, k] + gain[1, i] * cross[1, k]
            covariance[i, k] -= probability * reduction
            covariance[k, i] = covariance[i, k]


# Prior probability that the target manoeuvres before a plot.
MANOEUVRE_PROBABILITY = 0.1
# A plot of a track with at least OWNING_HITS plots does not start another track.
OWNING_HITS = 3
# Tentative tracks end with more than this many consecutive misses.
TENTATIVE_MISSES = 1
_LOG_MODE = np.log([1.0 - MANOEUVRE_PROBABILITY, MANOEUVRE_PROBABILITY])


class Columns(NamedTuple):
    """The plots, and for each plot the track that it would start: the state after its last plot."""

    time_s: Float1
    cloud: Float1
    measurement: Float2
    pose: Float2
    position: Float2
    log_ratio: Float1
    mean: Float2
    covariance: Float3
    last: Int1  # The last plot of the track
    hits: Int1
    score: Float1


class Numbers(NamedTuple):
    """The numbers of a `tracks.LinkModel`, and those that follow from it."""

    rotation_s: float
    most_misses: float
    variance: Float1
    densities: Float1
    gate: float  # Standard deviations
    least_hits: int  # A track with so many plots is confirmed
    log_miss: float
    log_detection: float  # Log density of a detection relative to that of clutter
    places: bool  # See `plots.Plots`


@inner
def _looks(plots: Columns, earlier: int, later: int, rotation_s: float) -> float:
    """Return the number of looks between two plots; a part counts as a part."""
    if rotation_s > 0.0:
        return float((plots.time_s[later] - plots.time_s[earlier]) / rotation_s)
    return float(plots.cloud[later] - plots.cloud[earlier])


@inner
def _may_be_near(plots: Columns, track: int, plot: int, numbers: Numbers) -> bool:
    """Return whether a plot may be within the gate of a track, by a coarse upper bound."""
    dt = plots.time_s[plot] - plots.time_s[plots.last[track]]
    # The beam passes a target once a revolution: two plots of a track are at least this share of it
    # apart.
    if numbers.rotation_s > 0.0 and dt <= 0.5 * numbers.rotation_s:
        return False
    mean, covariance = plots.mean[track], plots.covariance[track]
    east = plots.position[plot, 0] - mean[0] - dt * mean[2]
    north = plots.position[plot, 1] - mean[1] - dt * mean[3]
    place = covariance[0, 0] + covariance[1, 1]
    trace = 2.0 * (place + dt * dt * (covariance[2, 2] + covariance[3, 3]))
    trace += numbers.densities[1] * dt * dt * dt + numbers.variance[0]
    # The variance across the line of sight, at the plot's range.
    distance = 1.0 if numbers.places else plots.measurement[plot, 0]
    trace += distance**2 * numbers.variance[1]
    return bool(east * east + north * north < (1.5 * numbers.gate) ** 2 * trace)


@compiled
def _score_pairs(
    rows: Int1, batch: Int1, plots: Writeable[Columns], numbers: Numbers
) -> tuple[FloatArray, IntArray]:
    """Return the scores of tracks and plots, (R, B), and the likelier mode; -inf outside the gate.

    A score is relative to that of a missed detection in this look.
    """
    score = np.full((len(rows), len(batch)), -np.inf)
    likelier = np.zeros((len(rows), len(batch)), np.int64)
    mean, covariance = np.empty(4), np.empty((4, 4))
    step, log_mode = np.empty((2, 2, 4)), np.empty(2)
    for i, track in enumerate(rows):
        for k, plot in enumerate(batch):
            if not _may_be_near(plots, track, plot, numbers):
                continue
            dt, nearest = plots.time_s[plot] - plots.time_s[plots.last[track]], np.inf
            for mode in range(2):
                copy(plots.mean[track], plots.covariance[track], mean, covariance)
                predict(mean, covariance, dt, numbers.densities[mode])
                _, _, square, determinant = innovate(
                    mean,
                    covariance,
                    plots.measurement[plot],
                    plots.pose[plot],
                    numbers.variance,
                    numbers.places,
                    step,
                )
                nearest = min(nearest, square)
                log_mode[mode] = _LOG_MODE[mode] - 0.5 * (square + math.log(determinant))
            if nearest < numbers.gate**2:
                likelier[i, k] = log_mode[1] > log_mode[0]
                looks = _looks(plots, plots.last[track], plot, numbers.rotation_s)
                misses = max(round(looks) - 1.0, 0.0)
                score[i, k] = (
                    np.logaddexp(log_mode[0], log_mode[1])
                    + numbers.log_detection
                    + plots.log_ratio[plot]
                    + (misses - 1.0) * numbers.log_miss
                )
    return score, likelier


@compiled
def best_assignment(score: Float2) -> IntArray:
    """Return the column of each row, or -1: the assignment of the largest sum of positive scores.

    Rows are added one by one, each by the shortest augmenting path along reduced costs (Crouse,
    "On implementing 2D rectangular assignment algorithms", IEEE Trans. AES 52(4), 2016). A path may
    also end at a row that loses its column, at no cost.
    """
    rows, columns = score.shape
    column, owner = np.full(rows, -1), np.full(columns, -1)
    row_price, price = np.zeros(rows), np.zeros(columns)
    shortest, seen = np.empty(columns), np.empty(columns, np.bool_)
    before = np.zeros(columns, np.int64)
    for first in range(rows):
        shortest[:] = np.inf
        seen[:] = False
        row, length, loser, loss, end = first, 0.0, first, np.inf, -1
        while True:
            if length - row_price[row] < loss:
                loser, loss = row, length - row_price[row]
            nearest = -1
            for k in range(columns):
                if seen[k]:
                    continue
                path = length - score[row, k] - row_price[row] - price[k]
                if score[row, k] > 0.0 and path < shortest[k]:
                    shortest[k], before[k] = path, row
                if shortest[k] < np.inf and (nearest < 0 or shortest[k] < shortest[nearest]):
                    nearest = k
            if nearest < 0 or loss <= shortest[nearest]:
                length, end, column[loser] = loss, column[loser], -1
                break
            length, seen[nearest] = shortest[nearest], True
            if owner[nearest] < 0:
                end = nearest
                break
            row = owner[nearest]
        row_price[first] += length
        for k in range(columns):
            if seen[k] and owner[k] >= 0:
                row_price[owner[k]] += length - shortest[k]
                price[k] -= length - shortest[k]
        while end >= 0:
            row = before[end]
            owner[end] = row
            column[row], end = end, column[row]
    return column


@inner
def _add_plot(
    plots: Columns, track: int, plot: int, density: float, numbers: Numbers, step: FloatArray
) -> None:
    """Update a track; `step` is written over."""
    mean, covariance = plots.mean[track], plots.covariance[track]
    predict(mean, covariance, plots.time_s[plot] - plots.time_s[plots.last[track]], density)
    measured, pose = plots.measurement[plot], plots.pose[plot]
    found = innovate(mean, covariance, measured, pose, numbers.variance, numbers.places, step)
    update(1.0, found, step, mean, covariance)
    plots.last[track] = plot
    plots.hits[track] += 1


@inner
def _goes_on(plots: Columns, track: int, plot: int, numbers: Numbers) -> bool:
    """Return whether a track has few consecutive misses at the time of a plot."""
    # A look is missed half a revolution after it was due, or when the next cloud has come.
    missed = _looks(plots, plots.last[track], plot, numbers.rotation_s)
    missed -= 0.5 if numbers.rotation_s > 0.0 else 1.0
    tentative = plots.hits[track] < OWNING_HITS
    return bool(missed <= (TENTATIVE_MISSES if tentative else numbers.most_misses))


@compiled
def link(order: Int1, first: Int1, plots: Writeable[Columns], numbers: Numbers) -> IntArray:
    """Return the track to which each plot was added, or -1; a track is that of its first plot.

    `order` has the plots batch by batch, and `first` the first of each batch, and their number. In
    each batch, plots are assigned to confirmed tracks, then to tentative ones; the rest start
    tracks.
    """
    added_to, step = np.full(len(order), -1), np.empty((2, 2, 4))
    current, rows, free = np.empty_like(order), np.empty_like(order), np.empty_like(order)
    tracks = 0
    for batch in range(len(first) - 1):
        begin, left = first[batch], first[batch + 1] - first[batch]
        for k in range(left):
            free[k] = order[begin + k]
        going_on = 0
        for i in range(tracks):
            if _goes_on(plots, current[i], order[begin], numbers):
                current[going_on] = current[i]
                going_on += 1
        for confirmed in (True, False):
            count, still = 0, 0
            for i in range(going_on):
                if (plots.hits[current[i]] >= numbers.least_hits) == confirmed:
                    rows[count] = current[i]
                    count += 1
            score, likelier = _score_pairs(rows[:count], free[:left], plots, numbers)
            column = best_assignment(score)
            for i in range(count):
                if column[i] >= 0:
                    plot, density = free[column[i]], numbers.densities[likelier[i, column[i]]]
                    _add_plot(plots, rows[i], plot, density, numbers, step)
                    plots.score[rows[i]] += score[i, column[i]] + numbers.log_miss
                    added_to[plot] = rows[i]
            for k in range(left):
                track = added_to[free[k]]
                if track < 0 or plots.hits[track] < OWNING_HITS:
                    free[still] = free[k]
                    still += 1
            left = still
        tracks = going_on + left
        for k in range(left):
            current[going_on + k] = free[k]
    return added_to


# Transition probabilities [mode, mode at the next plot], and the probabilities of the modes at a
# track's first plot.
MODE_TRANSITION = np.array([[0.95, 0.05], [0.2, 0.8]])
INITIAL_MODE_PROBABILITY = np.array([0.8, 0.2])
# Smallest likelihood, which has a logarithm.
TINY = float(np.finfo(float).tiny)


class Points(NamedTuple):
    """B points at which the likelihood is computed."""

    start_mean: Float3  # Mean of each track at its first plot, (B, T, 4)
    start_covariance: Float4  # (B, T, 4, 4)
    variance: Float3  # Variances of the components of the noise, (B, C, 2)
    density: Float2  # Spectral density of each mode's acceleration, (B, 2)


class Plots(NamedTuple):
    """K plots of T tracks."""

    first: Int1  # The first plot of each track, and K, (T + 1,)
    time_s: Float1  # (K,)
    measurement: Float2  # (K, 2)
    pose: Float2  # Of the radar, (K, 3)
    # Log density of clutter in the gate relative to the peak of a target's density with the usual
    # noise, (K,).
    log_clutter: Float1
    places: bool  # See `plots.Plots`


class _Scratch(NamedTuple):
    """Working arrays for one update."""

    parts: Float1  # Log weight of each component, and of clutter, (C + 1,)
    found: Float2  # Results of `linking.innovate` for each component, (C, 4)
    step: Float4  # (C, 2, 2, 4)


@inner
def _mix(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    mixed_mean: FloatArray,
    mixed_covariance: FloatArray,
    later: FloatArray,
) -> None:
    """Write the moment-matched Gaussian of each mode at the next plot, and its probability."""
    for mode in range(2):
        first = probability[0] * MODE_TRANSITION[0, mode]
        later[mode] = first + probability[1] * MODE_TRANSITION[1, mode]
        share = first / max(later[mode], TINY)
        for i in range(4):
            mixed_mean[mode, i] = share * mean[0, i] + (1.0 - share) * mean[1, i]
            for k in range(4):
                apart = (mean[0, i] - mean[1, i]) * (mean[0, k] - mean[1, k])
                mixed_covariance[mode, i, k] = (
                    share * covariance[0, i, k]
                    + (1.0 - share) * covariance[1, i, k]
                    + share * (1.0 - share) * apart
                )


@inner
def _update(
    plots: Plots,
    k: int,
    variance: FloatArray,
    log_share: FloatArray,
    scratch: _Scratch,
    mean: FloatArray,
    covariance: FloatArray,
) -> float:
    """Update a Gaussian with plot `k`, and return the log density of the measurement."""
    measured, pose, log_clutter = plots.measurement[k], plots.pose[k], plots.log_clutter[k]
    (parts, found, step), count = scratch, len(log_share)
    for c in range(count):
        found[c, 0], found[c, 1], found[c, 2], found[c, 3] = innovate(
            mean, covariance, measured, pose, variance[c], plots.places, step[c]
        )
        log_peak = -0.5 * math.log(4.0 * math.pi**2 * found[c, 3])
        if c == 0:
            parts[count] = log_peak + log_clutter
        parts[c] = log_peak + log_share[c] - 0.5 * found[c, 2]
    total, highest = 0.0, max(parts)
    for part in parts:
        total += math.exp(part - highest)
    log_density = highest + math.log(total)
    for c in range(count):
        probability = math.exp(parts[c] - log_density)
        update(probability, found[c], step[c], mean, covariance)
    return float(log_density)


@compiled
def filter_tracks(points: Points, log_share: Float1, plots: Plots) -> FloatArray:
    """Return the log likelihood at B points, by a filter of each track from its first plot.

    `log_share`, (C,), has the logarithms of the shares of the components of the noise.
    """
    start_mean, start_covariance, variance, density = points
    first, time_s = plots.first, plots.time_s
    total = np.zeros(len(variance))
    mean, mixed_mean = np.empty((2, 4)), np.empty((2, 4))
    covariance, mixed_covariance = np.empty((2, 4, 4)), np.empty((2, 4, 4))
    probability, joint, count = np.empty(2), np.empty(2), len(log_share)
    scratch = _Scratch(np.empty(count + 1), np.empty((count, 4)), np.empty((count, 2, 2, 4)))
    for point in range(len(variance)):
        for track in range(len(first) - 1):
            for mode in range(2):
                probability[mode] = INITIAL_MODE_PROBABILITY[mode]
                begin, spread = start_mean[point, track], start_covariance[point, track]
                copy(begin, spread, mean[mode], covariance[mode])
            for k in range(first[track] + 1, first[track + 1]):
                dt = time_s[k] - time_s[k - 1]
                _mix(mean, covariance, probability, mixed_mean, mixed_covariance, joint)
                mean, mixed_mean = mixed_mean, mean
                covariance, mixed_covariance = mixed_covariance, covariance
                for mode in range(2):
                    predict(mean[mode], covariance[mode], dt, density[point, mode])
                    joint[mode] *= math.exp(
                        _update(
                            plots,
                            k,
                            variance[point],
                            log_share,
                            scratch,
                            mean[mode],
                            covariance[mode],
                        )
                    )
                likelihood = joint[0] + joint[1]
                total[point] += math.log(max(likelihood, TINY))
                for mode in range(2):
                    probability[mode] = joint[mode] / max(likelihood, TINY)
    return total
