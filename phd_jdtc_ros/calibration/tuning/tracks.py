"""Links plots to tracks by global nearest neighbour (GNN), and scores each track.

A track's score is the log likelihood ratio of its plots, target to clutter (Blackman and Popoli,
Sec. 6.2); the sum over all tracks measures how well a model of the noise explains a recording.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray, contiguous
from phd_jdtc_ros.core.compilation import Float1, Float2, Float3, Int1, compiled, inner

from . import kinematics
from .filter_steps import copy, innovate, predict, update
from .plots import Plots
from .rotation import Timing

# Share of a turn whose plots are assigned together.
BATCH = 1.0 / 12.0
# The beam passes a target once a turn: two plots of a track are at least this share of it apart.
LEAST_SPACING = 0.5
# Gate, in standard deviations.
GATE = 4.5
# Initial score of a track: the log prior that an unassociated plot is of a new target.
LOG_NEW = -np.log(50.0)
# A track is accepted with at least this many plots and this score.
LEAST_HITS, LEAST_SCORE = 5, 8.0
# Least share of an accepted track's plots that belong to no better track.
LEAST_OWN = 0.7
# Prior probability that the target manoeuvres before a plot.
MANOEUVRE_PROBABILITY = 0.1
# A plot of a track with at least OWNING_HITS plots does not start another track.
OWNING_HITS = 3
# A track ends when its misses are less probable than `IMPROBABLE`, within these bounds on their
# number.
IMPROBABLE, LEAST_MISSES, MOST_MISSES = 0.005, 3, 6
# Tentative tracks end with more than this many consecutive misses.
TENTATIVE_MISSES = 1
_LOG_MODE = np.log([1.0 - MANOEUVRE_PROBABILITY, MANOEUVRE_PROBABILITY])


@dataclass(frozen=True)
class NoiseModel:
    """Measurement noise and process noise."""

    range_std: float  # Standard deviation of a range, metres
    azimuth_std: float  # Standard deviation of an azimuth, radians
    # Spectral densities of the white acceleration at constant velocity and in a manoeuvre, m^2/s^3.
    densities: tuple[float, float]


@dataclass(frozen=True)
class LinkModel(NoiseModel):
    """Assumed model of a radar and its targets, used to link plots."""

    # Standard deviation of a new target's velocity along each axis, metres per second.
    speed_std: float
    detection_probability: float
    clutter_rate: float  # Mean number of false plots per look

    @property
    def variance(self) -> FloatArray:
        """Variances of range and azimuth, shape (2,)."""
        return np.array([self.range_std, self.azimuth_std]) ** 2

    @property
    def log_miss(self) -> float:
        """Log probability of a missed detection."""
        return float(np.log(1.0 - self.detection_probability))


@dataclass(frozen=True)
class Tracks:
    """The tracks found in a recording."""

    plots: tuple[IntArray, ...]  # The indices of each track's plots, ordered by time
    score: float  # Sum of the tracks' log likelihood ratios

    @property
    def claimed(self) -> IntArray:
        """Indices of the plots in tracks."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *self.plots])


class _Columns(NamedTuple):
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


class _Numbers(NamedTuple):
    """The numbers of a `LinkModel`, and those that follow from it."""

    rotation_s: float
    most_misses: float
    variance: Float1
    densities: Float1
    log_miss: float
    log_detection: float  # Log density of a detection relative to that of clutter


@inner
def _looks(plots: _Columns, earlier: int, later: int, rotation_s: float) -> float:
    """Return the number of looks between two plots; turns are not rounded."""
    if rotation_s > 0.0:
        return float((plots.time_s[later] - plots.time_s[earlier]) / rotation_s)
    return float(plots.cloud[later] - plots.cloud[earlier])


@inner
def _may_be_near(plots: _Columns, track: int, plot: int, numbers: _Numbers) -> bool:
    """Return whether a plot may be within the gate of a track, by a coarse upper bound."""
    dt = plots.time_s[plot] - plots.time_s[plots.last[track]]
    if numbers.rotation_s > 0.0 and dt <= LEAST_SPACING * numbers.rotation_s:
        return False
    mean, covariance = plots.mean[track], plots.covariance[track]
    east = plots.position[plot, 0] - mean[0] - dt * mean[2]
    north = plots.position[plot, 1] - mean[1] - dt * mean[3]
    place = covariance[0, 0] + covariance[1, 1]
    trace = 2.0 * (place + dt * dt * (covariance[2, 2] + covariance[3, 3]))
    trace += numbers.densities[1] * dt * dt * dt + numbers.variance[0]
    # The variance across the line of sight, at the plot's range.
    trace += plots.measurement[plot, 0] ** 2 * numbers.variance[1]
    return bool(east * east + north * north < (1.5 * GATE) ** 2 * trace)


@compiled
def _score_pairs(
    rows: Int1, batch: Int1, plots: _Columns, numbers: _Numbers
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
                    step,
                )
                nearest = min(nearest, square)
                log_mode[mode] = _LOG_MODE[mode] - 0.5 * (square + math.log(determinant))
            if nearest < GATE**2:
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
def _best_assignment(score: Float2) -> IntArray:
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
    plots: _Columns, track: int, plot: int, density: float, numbers: _Numbers, step: FloatArray
) -> None:
    """Update a track; `step` is written over."""
    mean, covariance = plots.mean[track], plots.covariance[track]
    predict(mean, covariance, plots.time_s[plot] - plots.time_s[plots.last[track]], density)
    measured, pose = plots.measurement[plot], plots.pose[plot]
    found = innovate(mean, covariance, measured, pose, numbers.variance, step)
    update(1.0, found, step, mean, covariance)
    plots.last[track] = plot
    plots.hits[track] += 1


@inner
def _goes_on(plots: _Columns, track: int, plot: int, numbers: _Numbers) -> bool:
    """Return whether a track has few consecutive misses at the time of a plot."""
    # A look is missed half a turn after it was due, or when the next cloud has come.
    missed = _looks(plots, plots.last[track], plot, numbers.rotation_s)
    missed -= 0.5 if numbers.rotation_s > 0.0 else 1.0
    tentative = plots.hits[track] < OWNING_HITS
    return bool(missed <= (TENTATIVE_MISSES if tentative else numbers.most_misses))


@compiled
def _link(order: Int1, first: Int1, plots: _Columns, numbers: _Numbers) -> IntArray:
    """Return the track to which each plot was added, or -1; a track is that of its first plot.

    For `order` and `first` see `_batches`. In each batch, plots are assigned to confirmed tracks,
    then to tentative ones; the rest start tracks.
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
                if (plots.hits[current[i]] >= LEAST_HITS) == confirmed:
                    rows[count] = current[i]
                    count += 1
            score, likelier = _score_pairs(rows[:count], free[:left], plots, numbers)
            column = _best_assignment(score)
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


def link_plots(plots: Plots, timing: Timing, model: LinkModel, log_ratio: FloatArray) -> Tracks:
    """Return the tracks of a recording.

    `log_ratio`, shape (N,), has the log likelihood ratio of each plot's amplitude, target to
    clutter; 0 where unknown.
    """
    misses = np.log(IMPROBABLE) / np.log(max(1.0 - model.detection_probability, 1e-3))
    farthest = float(plots.measurement[:, 0].max(initial=1.0))
    log_clutter = np.log(max(model.clutter_rate, 0.1) / (2.0 * np.pi * farthest))
    numbers = _Numbers(
        timing.rotation_s,
        float(np.clip(np.ceil(misses), LEAST_MISSES, MOST_MISSES)),
        model.variance,
        np.array(model.densities),
        model.log_miss,
        float(np.log(model.detection_probability) - log_clutter - np.log(2.0 * np.pi)),
    )
    count = len(plots)
    measured = plots.measurement, plots.pose
    columns = _Columns._make(
        contiguous(
            plots.time_s,
            plots.cloud.astype(np.float64),
            *measured,
            plots.position,
            log_ratio,
            *kinematics.initial_state(*measured, model.variance, model.speed_std),
            np.arange(count),
            np.ones(count, dtype=np.int64),
            LOG_NEW + log_ratio,
        )
    )
    added_to = _link(*_batches(plots, timing), columns, numbers)
    track, plot = np.append(np.arange(count), added_to), np.tile(np.arange(count), 2)
    kept = (track >= 0) & (columns.hits[track] >= LEAST_HITS)
    order = np.flatnonzero(kept)[np.argsort(track[kept], kind="stable")]
    starts = np.flatnonzero(np.diff(track[order], prepend=-1))
    return _accepted(np.split(plot[order], starts[1:]), columns.score[track[order[starts]]])


def _accepted(tracks: list[IntArray], scores: FloatArray) -> Tracks:
    """Return the tracks that are accepted; a plot of two tracks goes to that of better score."""
    taken: set[int] = set()
    accepted, total = [], 0.0
    for index in np.argsort(-scores, kind="stable"):
        own = [plot for plot in tracks[index].tolist() if plot not in taken]
        enough = len(own) >= max(LEAST_HITS, LEAST_OWN * len(tracks[index]))
        if enough and scores[index] >= LEAST_SCORE:
            taken.update(own)
            accepted.append(np.array(own))
            total += float(scores[index])
    return Tracks(tuple(accepted), total)


def _batches(plots: Plots, timing: Timing) -> tuple[IntArray, IntArray]:
    """Return the plots batch by batch, and the first of each batch, and their number.

    Those of a batch are assigned together: those of a cloud, or of a share of a turn.
    """
    number: FloatArray = plots.cloud.astype(np.float64)
    if timing.rotation_s:
        number = np.floor(plots.time_s / (BATCH * timing.rotation_s))
    order = np.argsort(number, kind="stable")
    edges = np.flatnonzero(np.diff(number[order], prepend=-np.inf))
    return order, np.append(edges, len(order))
