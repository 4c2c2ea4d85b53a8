"""Links plots to tracks by global nearest neighbour (GNN), and scores each track.

A track's score is the log likelihood ratio of its plots, target to clutter (Blackman and Popoli,
Sec. 6.2); the sum over all tracks measures how well a model of the noise explains a recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from . import kinematics
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


def link_plots(plots: Plots, timing: Timing, model: LinkModel, log_ratio: FloatArray) -> Tracks:
    """Return the tracks of a recording.

    `log_ratio`, shape (N,), has the log likelihood ratio of each plot's amplitude, target to
    clutter; 0 where unknown.
    """
    linker = _Linker(plots, timing, model, log_ratio)
    for batch in _batches(plots, timing):
        linker.add(batch)
    return linker.finish()


def _batches(plots: Plots, timing: Timing) -> list[IntArray]:
    """Return the plots that are assigned together: of a cloud, or of a share of a turn."""
    if not len(plots):
        return []
    number: FloatArray = plots.cloud.astype(np.float64)
    if timing.rotation_s:
        number = np.floor(plots.time_s / (BATCH * timing.rotation_s))
    order = np.argsort(number, kind="stable")
    edges = np.flatnonzero(np.diff(number[order])) + 1
    return np.split(order, edges)


class _TrackRows(NamedTuple):
    """The current tracks, one row each: state, time and cloud after the last plot."""

    mean: FloatArray
    covariance: FloatArray
    time_s: FloatArray
    cloud: FloatArray
    hits: IntArray
    score: FloatArray
    number: IntArray  # Index of the track's list in `_Linker._plots_of`

    def take(self, rows: IntArray) -> _TrackRows:
        """Return some tracks."""
        return _TrackRows._make(column[rows] for column in self)

    def append(self, other: _TrackRows) -> _TrackRows:
        """Return these tracks and others."""
        return _TrackRows._make(map(np.concatenate, zip(self, other, strict=True)))


class _Linker:
    """Links plots to tracks, batch by batch."""

    def __init__(
        self, plots: Plots, timing: Timing, model: LinkModel, log_ratio: FloatArray
    ) -> None:
        self._plots, self._timing, self._model, self._log_ratio = plots, timing, model, log_ratio
        misses = np.log(IMPROBABLE) / np.log(max(1.0 - model.detection_probability, 1e-3))
        self._max_misses = float(np.clip(np.ceil(misses), LEAST_MISSES, MOST_MISSES))
        farthest = float(plots.measurement[:, 0].max(initial=1.0))
        # Log density of clutter in range and azimuth.
        self._log_clutter = np.log(max(model.clutter_rate, 0.1) / (2.0 * np.pi * farthest))
        self._position = plots.position
        self._plots_of: list[list[int]] = []
        self._tracks = self._new(np.zeros(0, dtype=np.int64))
        self._ended: list[tuple[list[int], float]] = []

    def add(self, batch: IntArray) -> None:
        """Assign plots to confirmed tracks, then to tentative ones; the rest start tracks."""
        self._end(float(self._plots.time_s[batch].min()), float(self._plots.cloud[batch].min()))
        confirmed = self._tracks.hits >= LEAST_HITS
        for rows in (np.flatnonzero(confirmed), np.flatnonzero(~confirmed)):
            if len(rows) and len(batch):
                batch = np.setdiff1d(batch, self._assign(rows, batch))
        if len(batch):
            self._tracks = self._tracks.append(self._new(batch))

    def finish(self) -> Tracks:
        """End all tracks and return the accepted ones."""
        self._end(np.inf, np.inf)
        # A plot in two tracks goes to the track with the better score.
        taken: set[int] = set()
        accepted, total = [], 0.0
        for plots, score in sorted(self._ended, key=lambda entry: -entry[1]):
            own = [plot for plot in plots if plot not in taken]
            if score >= LEAST_SCORE and len(own) >= max(LEAST_HITS, LEAST_OWN * len(plots)):
                taken.update(own)
                accepted.append(np.array(own))
                total += score
        return Tracks(tuple(accepted), total)

    def _end(self, now_s: float, cloud: float) -> None:
        """End the tracks with too many consecutive misses before a time and a cloud."""
        tracks = self._tracks
        looks = self._timing.looks(now_s - tracks.time_s, cloud - tracks.cloud)
        # A look is missed half a turn after it was due, or when the next cloud has come.
        missed = looks - (0.5 if self._timing.rotation_s else 1.0)
        ended = missed > np.where(tracks.hits < OWNING_HITS, TENTATIVE_MISSES, self._max_misses)
        for row in np.flatnonzero(ended & (tracks.hits >= LEAST_HITS)).tolist():
            self._ended.append((self._plots_of[tracks.number[row]], float(tracks.score[row])))
        self._tracks = tracks.take(np.flatnonzero(~ended))

    def _assign(self, rows: IntArray, batch: IntArray) -> IntArray:
        """Update tracks with the assignment of the largest total score.

        Return the assigned plots that may not start another track; see `OWNING_HITS`.
        """
        row, plot = self._candidates(rows, batch)
        if not len(row):
            return plot
        tracks, plots, model = self._tracks, self._plots, self._model
        dt = plots.time_s[plot] - tracks.time_s[row]
        # Both modes are in the leading axis: shapes (2, P, ...).
        density = np.array(model.densities)[:, None] * np.ones(len(row))
        mean, covariance = kinematics.predict(tracks.mean[row], tracks.covariance[row], dt, density)
        found = kinematics.innovation(
            mean, covariance, plots.measurement[plot], plots.pose[plot], model.variance
        )
        distance2 = found.distance2
        near = np.flatnonzero(distance2.min(axis=0) < GATE**2)
        log_mode = _LOG_MODE[:, None] - 0.5 * distance2 - 0.5 * np.log(found.determinant)
        score = self._scores(row, plot, log_mode)
        # The assignment compares each score with that of a missed detection in this look.
        better = score[near] - model.log_miss
        chosen = near[_best_assignment(row[near], plot[near], better)]
        row, plot, mode = row[chosen], plot[chosen], np.argmax(log_mode[:, chosen], axis=0)
        cross = found.cross[mode, chosen]
        gain = cross @ found.inverse[mode, chosen]
        tracks.mean[row] = mean[chosen] + np.einsum("pij,pj->pi", gain, found.value[chosen])
        later = covariance[mode, chosen] - gain @ cross.swapaxes(1, 2)
        tracks.covariance[row] = 0.5 * (later + later.swapaxes(1, 2))
        tracks.score[row] += score[chosen]
        tracks.time_s[row], tracks.cloud[row] = plots.time_s[plot], plots.cloud[plot]
        tracks.hits[row] += 1
        for number, index in zip(tracks.number[row], plot.tolist(), strict=True):
            self._plots_of[number].append(index)
        return plot[tracks.hits[row] >= OWNING_HITS]

    def _candidates(self, rows: IntArray, batch: IntArray) -> tuple[IntArray, IntArray]:
        """Return the pairs (row, plot) that may be within the gate, by a coarse upper bound."""
        tracks, plots, model = self._tracks, self._plots, self._model
        row, plot = (grid.ravel() for grid in np.meshgrid(rows, batch, indexing="ij"))
        dt = plots.time_s[plot] - tracks.time_s[row]
        if self._timing.rotation_s:
            apart = dt > LEAST_SPACING * self._timing.rotation_s
            row, plot, dt = row[apart], plot[apart], dt[apart]
        expected = tracks.mean[row, :2] + dt[:, None] * tracks.mean[row, 2:]
        distance2 = ((self._position[plot] - expected) ** 2).sum(axis=1)
        variance = np.diagonal(tracks.covariance, axis1=1, axis2=2)
        place, speed = variance[:, :2].sum(axis=1), variance[:, 2:].sum(axis=1)
        trace = 2.0 * (place[row] + dt**2 * speed[row])
        trace += model.densities[1] * dt**3 + model.range_std**2
        # The azimuth's standard deviation in metres, at the plot's range.
        trace += (plots.measurement[plot, 0] * model.azimuth_std) ** 2
        near = np.flatnonzero(distance2 < (1.5 * GATE) ** 2 * trace)
        return row[near], plot[near]

    def _scores(self, row: IntArray, plot: IntArray, log_mode: FloatArray) -> FloatArray:
        """Return the log likelihood ratios of pairs, given those of both modes, shape (P,)."""
        tracks, plots, model = self._tracks, self._plots, self._model
        elapsed = plots.time_s[plot] - tracks.time_s[row], plots.cloud[plot] - tracks.cloud[row]
        misses = np.maximum(np.round(self._timing.looks(*elapsed)) - 1.0, 0.0)
        return np.asarray(
            np.logaddexp(*log_mode)
            - np.log(2.0 * np.pi)
            + np.log(model.detection_probability)
            + misses * model.log_miss
            - self._log_clutter
            + self._log_ratio[plot]
        )

    def _new(self, batch: IntArray) -> _TrackRows:
        """Return a tentative track for each plot."""
        plots, count = self._plots, len(batch)
        first = len(self._plots_of)
        self._plots_of += [[index] for index in batch.tolist()]
        return _TrackRows(
            *kinematics.initial_state(
                plots.measurement[batch],
                plots.pose[batch],
                self._model.variance,
                self._model.speed_std,
            ),
            plots.time_s[batch],
            plots.cloud[batch].astype(np.float64),
            np.ones(count, dtype=np.int64),
            LOG_NEW + self._log_ratio[batch],
            first + np.arange(count),
        )


def _best_assignment(row: IntArray, plot: IntArray, score: FloatArray) -> IntArray:
    """Return the indices of the assignment with the largest total score."""
    rows, i = np.unique(row, return_inverse=True)
    columns, j = np.unique(plot, return_inverse=True)
    table = np.zeros((len(rows), len(columns)))
    pair = np.full(table.shape, -1)
    table[i, j] = np.maximum(score, 0.0)
    pair[i, j] = np.where(score > 0.0, np.arange(len(score)), -1)
    chosen = pair[linear_sum_assignment(table, maximize=True)]
    pairs: IntArray = chosen[chosen >= 0]
    return pairs
