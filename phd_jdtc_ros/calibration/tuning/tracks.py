"""Plots linked to tracks: nearest neighbours, with the log likelihood ratio of every track.

A track's score is the log likelihood ratio of its plots, target to clutter (Blackman and Popoli,
Sec. 6.2); the sum over all tracks measures how well a guess of the noise explains a recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from . import kinematics
from .plots import Plots
from .rotation import Timing

# Share of a turn whose plots are assigned together.
BATCH = 1.0 / 12.0
# The beam passes a target once a turn: a track takes no second plot within this share of a turn.
AGAIN = 0.5
# Gate, in standard deviations.
GATE = 4.5
# Initial score of a track: the log prior that an unassociated plot is of a new target.
LOG_NEW = -np.log(50.0)
# A track is accepted with at least this many plots and this score.
LEAST_HITS, LEAST_SCORE = 5, 8.0
# Prior probability of a manoeuvre at a plot.
MANOEUVRES = 0.1
# Number of plots from which on a track's plots do not start other tracks.
SETTLED = 3
# A track ends when its misses are less probable than `IMPROBABLE`, within these bounds on their
# number.
IMPROBABLE, LEAST_MISSES, MOST_MISSES = 0.005, 3, 6
# Tentative tracks end with more than this many consecutive misses.
TENTATIVE_MISSES = 1
_LOG_MOTION = np.log([1.0 - MANOEUVRES, MANOEUVRES])


@dataclass(frozen=True)
class Deviations:
    """Measurement and process noise, which determine the gate of a target's next plot.

    Parameters
    ----------
    range_std, azimuth_std : float
        Standard deviations of a measurement, metres and radians.
    densities : tuple of two floats
        Spectral densities of the white acceleration at constant velocity and in a manoeuvre,
        m^2/s^3.
    """

    range_std: float
    azimuth_std: float
    densities: tuple[float, float]


@dataclass(frozen=True)
class Guess(Deviations):
    """The assumed model of a radar and its targets in linking.

    Parameters
    ----------
    range_std, azimuth_std, densities
        See `Deviations`.
    speed_std : float
        Standard deviation of a new target's velocity along each axis, metres per second.
    clutter_rate : float
        Mean number of false plots per look.
    """

    speed_std: float
    detection_probability: float
    clutter_rate: float


@dataclass(frozen=True)
class Tracks:
    """The tracks found in a recording.

    Parameters
    ----------
    plots : tuple of int arrays
        The indices of each track's plots, ordered by time.
    score : float
        Sum of the tracks' log likelihood ratios.
    """

    plots: tuple[IntArray, ...]
    score: float

    @property
    def claimed(self) -> IntArray:
        """Indices of the plots in tracks."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *self.plots])


def link_plots(plots: Plots, timing: Timing, guess: Guess, log_ratio: FloatArray) -> Tracks:
    """Return the tracks of a recording.

    Parameters
    ----------
    log_ratio : array of shape (N,)
        Log likelihood ratio of each plot's amplitude, target to clutter; 0 where unknown.
    """
    linker = _Linker(plots, timing, guess, log_ratio)
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


class _Linker:
    """The current tracks, one row each."""

    def __init__(self, plots: Plots, timing: Timing, guess: Guess, log_ratio: FloatArray) -> None:
        self._plots, self._timing, self._guess, self._log_ratio = plots, timing, guess, log_ratio
        misses = np.log(IMPROBABLE) / np.log(max(1.0 - guess.detection_probability, 1e-3))
        self._patience = float(np.clip(np.ceil(misses), LEAST_MISSES, MOST_MISSES))
        farthest = float(plots.measurement[:, 0].max(initial=1.0))
        # Log density of clutter in range and azimuth.
        self._log_density = np.log(max(guess.clutter_rate, 0.1) / (2.0 * np.pi * farthest))
        self._mean, self._covariance = np.zeros((0, 4)), np.zeros((0, 4, 4))
        self._time, self._look = np.zeros(0), np.zeros(0)
        self._hits, self._score = np.zeros(0, dtype=np.int64), np.zeros(0)
        self._number = np.zeros(0, dtype=np.int64)
        self._owned: list[list[int]] = []
        self._ended: list[tuple[list[int], float]] = []

    def add(self, batch: IntArray) -> None:
        """Assign plots to confirmed tracks, then to tentative ones; the rest start tracks."""
        now = float(self._plots.time_s[batch].min())
        self._end(now, float(self._plots.cloud[batch].min()))
        settled = self._hits >= LEAST_HITS
        taken = []
        for rows in (np.flatnonzero(settled), np.flatnonzero(~settled)):
            found = self._assign(rows, batch)
            batch = np.setdiff1d(batch, found[self._hits_of(found) >= SETTLED])
            taken.append(found)
        self._start(batch)

    def finish(self) -> Tracks:
        """End all tracks and return the accepted ones."""
        self._end(np.inf, np.inf)
        kept = [
            (owned, score)
            for owned, score in self._ended
            if len(owned) >= LEAST_HITS and score >= LEAST_SCORE
        ]
        # A plot in two tracks goes to the track with the better score.
        taken: set[int] = set()
        found, total = [], 0.0
        for owned, score in sorted(kept, key=lambda entry: -entry[1]):
            own = [plot for plot in owned if plot not in taken]
            if len(own) >= max(LEAST_HITS, 0.7 * len(owned)):
                taken.update(own)
                found.append(np.array(own))
                total += score
        return Tracks(tuple(found), total)

    def _hits_of(self, found: IntArray) -> IntArray:
        """Return, for each of some plots, the number of plots of the track that took it."""
        hits = dict.fromkeys(found.tolist(), 0)
        for row in range(len(self._number)):
            last = self._owned[self._number[row]][-1]
            if last in hits:
                hits[last] = max(hits[last], int(self._hits[row]))
        return np.array([hits[plot] for plot in found.tolist()], dtype=np.int64)

    def _missed_looks(self, time_s: FloatArray, cloud: FloatArray) -> FloatArray:
        """Return the number of looks between the tracks' last plots and a time or a cloud."""
        if self._timing.rotation_s:
            return np.maximum((time_s - self._time) / self._timing.rotation_s - 0.5, 0.0)
        return np.maximum(cloud - self._look - 1.0, 0.0)

    def _end(self, now: float, cloud: float) -> None:
        missed = self._missed_looks(np.array(now), np.array(cloud))
        patience = np.where(self._hits < SETTLED, TENTATIVE_MISSES, self._patience)
        ended = missed > patience
        for row in np.flatnonzero(ended).tolist():
            number = int(self._number[row])
            if self._hits[row] >= LEAST_HITS:
                self._ended.append((self._owned[number], float(self._score[row])))
        self._keep(np.flatnonzero(~ended))

    def _keep(self, rows: IntArray) -> None:
        for name in ("mean", "covariance", "time", "look", "hits", "score", "number"):
            setattr(self, f"_{name}", getattr(self, f"_{name}")[rows])

    def _assign(self, rows: IntArray, batch: IntArray) -> IntArray:
        """Update tracks with the assignment of the largest sum of gains; return its plots."""
        row, plot = (grid.ravel() for grid in np.meshgrid(rows, batch, indexing="ij"))
        if self._timing.rotation_s:
            fresh = self._plots.time_s[plot] - self._time[row] > AGAIN * self._timing.rotation_s
            row, plot = row[fresh], plot[fresh]
        reach = self._reach(row, plot)
        row, plot = row[reach], plot[reach]
        if not len(row):
            return np.zeros(0, dtype=np.int64)
        guess, plots = self._guess, self._plots
        dt = plots.time_s[plot] - self._time[row]
        # Both motions in the leading axis: shapes (2, P, ...).
        density = np.array(guess.densities)[:, None] * np.ones(len(row))
        mean, covariance = kinematics.predict(self._mean[row], self._covariance[row], dt, density)
        expected, jacobian = kinematics.linearise(mean[:, :2], plots.pose[plot])
        error = kinematics.innovation(plots.measurement[plot], expected)
        cross = covariance[..., :2] @ jacobian.swapaxes(1, 2)
        spread = jacobian @ cross[..., :2, :]
        spread[..., 0, 0] += guess.range_std**2
        spread[..., 1, 1] += guess.azimuth_std**2
        inverted, determinant = kinematics.inverse(spread)
        square = np.einsum("pi,rpij,pj->rp", error, inverted, error)
        near = np.flatnonzero(square.min(axis=0) < GATE**2)
        missed = np.round(self._looks(row, plot) - 1.0)
        of_motion = _LOG_MOTION[:, None] - 0.5 * square - 0.5 * np.log(determinant)
        gain = (
            np.logaddexp(*of_motion)
            - np.log(2.0 * np.pi)
            + np.log(guess.detection_probability)
            + missed * np.log(1.0 - guess.detection_probability)
            - self._log_density
            + self._log_ratio[plot]
        )
        # Relative to a miss in this look.
        better = gain[near] - np.log(1.0 - guess.detection_probability)
        chosen = near[_best_assignment(row[near], plot[near], better)]
        place, motion = row[chosen], np.argmax(of_motion[:, chosen], axis=0)
        cross = cross[motion, chosen]
        weight = cross @ inverted[motion, chosen]
        self._mean[place] = mean[chosen] + np.einsum("pij,pj->pi", weight, error[chosen])
        later = covariance[motion, chosen] - weight @ cross.swapaxes(1, 2)
        self._covariance[place] = 0.5 * (later + later.swapaxes(1, 2))
        self._score[place] += gain[chosen]
        self._time[place] = plots.time_s[plot[chosen]]
        self._look[place] = plots.cloud[plot[chosen]]
        self._hits[place] += 1
        for at, index in zip(place.tolist(), plot[chosen].tolist(), strict=True):
            self._owned[self._number[at]].append(index)
        return plot[chosen]

    def _looks(self, row: IntArray, plot: IntArray) -> FloatArray:
        """Return the number of looks from the tracks' last plots to other plots."""
        if self._timing.rotation_s:
            turns = (self._plots.time_s[plot] - self._time[row]) / self._timing.rotation_s
            return np.maximum(np.round(turns), 1.0)
        return np.maximum(self._plots.cloud[plot] - self._look[row], 1.0)

    def _reach(self, row: IntArray, plot: IntArray) -> IntArray:
        """Return the pairs that may be within the gate, by a coarse upper bound."""
        guess, plots = self._guess, self._plots
        dt = plots.time_s[plot] - self._time[row]
        expected = self._mean[row, :2] + dt[:, None] * self._mean[row, 2:]
        off = ((self._position[plot] - expected) ** 2).sum(axis=1)
        trace = self._covariance[row, 0, 0] + self._covariance[row, 1, 1]
        trace += dt**2 * (self._covariance[row, 2, 2] + self._covariance[row, 3, 3])
        trace *= 2.0
        trace += guess.densities[1] * dt**3 + guess.range_std**2
        # The azimuth's standard deviation in metres, at the plot's range.
        trace += (plots.measurement[plot, 0] * guess.azimuth_std) ** 2
        return np.flatnonzero(off < (1.5 * GATE) ** 2 * trace)

    @property
    def _position(self) -> FloatArray:
        if not hasattr(self, "_positions"):
            self._positions = self._plots.position
        return self._positions

    def _start(self, batch: IntArray) -> None:
        """Start a tentative track at each plot."""
        count, guess = len(batch), self._guess
        mean, covariance = kinematics.initial_state(
            self._plots.measurement[batch],
            self._plots.pose[batch],
            np.full(count, guess.range_std**2),
            np.full(count, guess.azimuth_std**2),
            guess.speed_std,
        )
        self._mean = np.concatenate([self._mean, mean])
        self._covariance = np.concatenate([self._covariance, covariance])
        self._time = np.concatenate([self._time, self._plots.time_s[batch]])
        self._look = np.concatenate([self._look, self._plots.cloud[batch].astype(np.float64)])
        self._hits = np.concatenate([self._hits, np.ones(count, dtype=np.int64)])
        self._score = np.concatenate([self._score, LOG_NEW + self._log_ratio[batch]])
        self._number = np.concatenate([self._number, len(self._owned) + np.arange(count)])
        self._owned += [[index] for index in batch.tolist()]


def _best_assignment(row: IntArray, plot: IntArray, gain: FloatArray) -> IntArray:
    """Return the indices of the assignment with the largest sum of gains."""
    rows, i = np.unique(row, return_inverse=True)
    columns, j = np.unique(plot, return_inverse=True)
    table = np.zeros((len(rows), len(columns)))
    pair = np.full(table.shape, -1)
    table[i, j], pair[i, j] = np.maximum(gain, 0.0), np.where(gain > 0.0, np.arange(len(gain)), -1)
    chosen = pair[linear_sum_assignment(table, maximize=True)]
    pairs: IntArray = chosen[chosen >= 0]
    return pairs
