"""A nearest-neighbour Kalman tracker for turning radars, as a simple baseline.

Every plot is compared with the tracks at its own time: nearly constant velocity, converted
measurements, global nearest neighbour among the plots of a small part of a revolution, confirmed
tracks first, M-of-N initiation, deletion after missed revolutions. It needs no other package.

The settings were chosen by the RMS error and the identity switches on seeds 0 to 3 of
`config/scenarios/terminal_radar.yaml`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports
from phd_jdtc_ros.study.tracker import SimulatedRun, TrackingResult, without_ignored

# Order of the state: x, vx, y, vy.
POSITION, VELOCITY = [0, 2], [1, 3]
# Share of a revolution whose plots are assigned together.
BATCH = 1.0 / 32.0
# The beam passes a target once a revolution: a track takes no second plot of a radar within this
# share of a revolution.
AGAIN = 0.5
# A track without a plot for this many revolutions is coasting.
SEEN_REVOLUTIONS = 1.25


@dataclass(frozen=True)
class Settings:
    """Settings of the nearest-neighbour Kalman tracker."""

    noise_density: float = 40.0  # Spectral density of the white acceleration, m^2/s^3
    # Standard deviation of a new track's velocity along each axis, metres per second.
    speed_std: float = 150.0
    gate: float = 4.5  # In standard deviations of the innovation
    # `hits`, `revolutions`: a track is confirmed by `hits` plots within `revolutions` revolutions.
    hits: int = 3
    revolutions: float = 4.5
    # `tentative_revolutions`, `coasted_revolutions`: a tentative and a confirmed track end after
    # this many revolutions without a plot.
    tentative_revolutions: float = 2.5
    coasted_revolutions: float = 3.5


SETTINGS = Settings()


class Plots:
    """All plots of a run, ordered by time, as positions with covariances."""

    def __init__(self, reports: Sequence[SimulatedReport], radars: Sequence[RadarModel]) -> None:
        columns = [
            _convert(report, radars[report.radar].at(report.detections.pose)) for report in reports
        ]
        time = np.concatenate([column[0] for column in columns])
        order = np.argsort(time, kind="stable")
        self.time: FloatArray = time[order]
        self.position: FloatArray = np.concatenate([column[1] for column in columns])[order]
        self.covariance: FloatArray = np.concatenate([column[2] for column in columns])[order]
        radar = [np.full(len(report.detections), report.radar) for report in reports]
        self.radar: IntArray = np.concatenate(radar)[order]


def _convert(
    report: SimulatedReport, radar: RadarModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (s), positions (M, 2) and their covariances (M, 2, 2) of a report's plots."""
    found = report.detections
    offset = np.zeros(len(found)) if found.time_s is None else found.time_s
    std = radar.noise_std_of(found)
    bearing = found.measurement[:, 1] + radar.yaw
    along = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    axes = np.stack([along, across], axis=2)
    spread = np.stack([std[:, 0], found.measurement[:, 0] * std[:, 1]], axis=1)
    covariance = np.einsum("mik,mk,mjk->mij", axes, spread**2, axes)
    return report.stamp_ns * 1e-9 + offset, radar.to_world(found.measurement), covariance


class Tracker:
    """The current tracks, one row each, of radars with these times of a revolution, seconds."""

    def __init__(self, settings: Settings, rotations: FloatArray) -> None:
        self.settings, self.rotations = settings, rotations
        self.mean = np.zeros((0, 4))
        self.covariance = np.zeros((0, 4, 4))
        # Times of each track's last and first plot, and of its last plot by radar.
        self.time, self.born = np.zeros(0), np.zeros(0)
        self.seen = np.zeros((0, len(rotations)))
        self.hits = np.zeros(0, dtype=np.int64)
        self.number = np.zeros(0, dtype=np.int64)
        self._numbers = 0

    def report(self, time: float) -> PointSet:
        """Return the confirmed tracks at a time."""
        self._end_tracks(time)
        rows = np.flatnonzero(self.hits >= self.settings.hits)
        mean, covariance = self._predict(rows, np.full(len(rows), time))
        class_id = np.zeros(len(rows), dtype=np.int64)
        return PointSet(
            mean[:, POSITION],
            class_id,
            track_id=self.number[rows],
            velocity=mean[:, VELOCITY],
            velocity_covariance=covariance[:, VELOCITY][:, :, VELOCITY],
            coasting=time - self.time[rows] > SEEN_REVOLUTIONS * self.rotations.min(),
        )

    def add(self, plots: Plots, batch: IntArray) -> None:
        """Assign plots to confirmed tracks, then to tentative ones; the rest start tracks."""
        self._end_tracks(float(plots.time[batch[0]]))
        confirmed = self.hits >= self.settings.hits
        for rows in (np.flatnonzero(confirmed), np.flatnonzero(~confirmed)):
            taken = self._update(plots, batch, rows)
            batch = np.setdiff1d(batch, taken)
        self._start(plots, batch)

    def _end_tracks(self, now: float) -> None:
        """Remove tracks without plots, and tentative tracks that are not confirmed in time."""
        settings, revolution_s = self.settings, float(self.rotations.min())
        tentative = self.hits < settings.hits
        patience = np.where(tentative, settings.tentative_revolutions, settings.coasted_revolutions)
        ended = now - self.time > patience * revolution_s
        ended |= tentative & (now - self.born > settings.revolutions * revolution_s)
        self._keep(np.flatnonzero(~ended))

    def _keep(self, rows: IntArray) -> None:
        for name in ("mean", "covariance", "time", "born", "seen", "hits", "number"):
            setattr(self, name, getattr(self, name)[rows])

    def _update(self, plots: Plots, batch: IntArray, rows: IntArray) -> IntArray:
        """Update tracks by global nearest neighbour; return the assigned plots."""
        row, column = (grid.ravel() for grid in np.meshgrid(rows, batch, indexing="ij"))
        radar = plots.radar[column]
        again = plots.time[column] - self.seen[row, radar] < AGAIN * self.rotations[radar]
        row, column = row[~again], column[~again]
        mean, covariance = self._predict(row, plots.time[column])
        error = plots.position[column] - mean[:, POSITION]
        inside = covariance[:, POSITION][:, :, POSITION] + plots.covariance[column]
        inverse = np.linalg.inv(inside)
        square = np.einsum("pi,pij,pj->p", error, inverse, error)
        near = np.flatnonzero(square < self.settings.gate**2)
        cost = square[near] + np.log(np.linalg.det(inside[near]))
        pair = near[_best_assignment(row[near], column[near], cost)]
        gain = covariance[pair][:, :, POSITION] @ inverse[pair]
        self.mean[row[pair]] = mean[pair] + np.einsum("pij,pj->pi", gain, error[pair])
        moved = gain @ covariance[pair][:, POSITION]
        self.covariance[row[pair]] = covariance[pair] - moved
        self.time[row[pair]] = plots.time[column[pair]]
        self.seen[row[pair], plots.radar[column[pair]]] = plots.time[column[pair]]
        self.hits[row[pair]] += 1
        return column[pair]

    def _predict(self, rows: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means (P, 4) and covariances (P, 4, 4) of tracks at times, shape (P,)."""
        dt = time - self.time[rows]
        step = np.tile(np.eye(4), (len(rows), 1, 1))
        step[:, 0, 1] = step[:, 2, 3] = dt
        noise = np.zeros_like(step)
        for x, v in ((0, 1), (2, 3)):
            noise[:, x, x], noise[:, v, v] = dt**3 / 3.0, dt
            noise[:, x, v] = noise[:, v, x] = dt**2 / 2.0
        mean = np.einsum("pij,pj->pi", step, self.mean[rows])
        covariance = step @ self.covariance[rows] @ step.transpose(0, 2, 1)
        return mean, covariance + self.settings.noise_density * noise

    def _start(self, plots: Plots, batch: IntArray) -> None:
        """Start a tentative track at each plot."""
        count = len(batch)
        mean, covariance = np.zeros((count, 4)), np.zeros((count, 4, 4))
        mean[:, POSITION] = plots.position[batch]
        covariance[:, [[0], [2]], [0, 2]] = plots.covariance[batch]
        covariance[:, [1, 3], [1, 3]] = self.settings.speed_std**2
        seen = np.full((count, len(self.rotations)), -np.inf)
        seen[np.arange(count), plots.radar[batch]] = plots.time[batch]
        fresh = {
            "mean": mean,
            "covariance": covariance,
            "time": plots.time[batch],
            "born": plots.time[batch],
            "seen": seen,
            "hits": np.ones(count, dtype=np.int64),
            "number": self._numbers + 1 + np.arange(count),
        }
        self._numbers += count
        for name, rows in fresh.items():
            setattr(self, name, np.concatenate([getattr(self, name), rows]))


def _best_assignment(row: IntArray, column: IntArray, cost: FloatArray) -> IntArray:
    """Return the indices of the cheapest assignment with the largest number of pairs."""
    rows, i = np.unique(row, return_inverse=True)
    columns, j = np.unique(column, return_inverse=True)
    # Cost of an impossible pair: far above any cost, yet small enough to keep precision.
    table = np.full((len(rows), len(columns)), 1e6)
    pair = np.full(table.shape, -1)
    table[i, j], pair[i, j] = cost, np.arange(len(cost))
    chosen: IntArray = pair[linear_sum_assignment(table)]
    return chosen[chosen >= 0]


def follow(
    reports: Sequence[SimulatedReport],
    radars: Sequence[RadarModel],
    stamps_ns: Sequence[int],
    settings: Settings = SETTINGS,
    rotations: FloatArray | None = None,
) -> list[PointSet]:
    """Return the confirmed tracks, predicted to ascending stamps.

    The tracks at a stamp use the plots up to it. `rotations` are the times between two looks of
    each radar, seconds; those of their antennas if not given.
    """
    plots = Plots(reports, radars)
    if rotations is None:
        rotations = np.array([radar.rotation_s for radar in radars])
    tracker = Tracker(settings, rotations)
    batch = np.floor(plots.time / (BATCH * rotations.min()))
    edges = np.searchsorted(plots.time, np.array(stamps_ns) * 1e-9, side="right")
    ends = np.unique([*(np.flatnonzero(np.diff(batch)) + 1), *edges, 0])
    found, begin = [], 0
    for stamp_ns, edge in zip(stamps_ns, edges, strict=True):
        for end in ends[(ends > begin) & (ends <= edge)].tolist():
            tracker.add(plots, np.arange(begin, end))
            begin = end
        found.append(tracker.report(stamp_ns * 1e-9))
    return found


def plot_kalman(
    run: SimulatedRun, parameters: Mapping[str, Any], lags: Sequence[int]
) -> TrackingResult:
    """Return the tracker's filtered estimates of a run of `turning.turning_run`.

    The parameters are the tracker's, for the layout of the radars' messages: whether plots have
    times. All lags get the filtered estimates, since there is no smoother.
    """
    reports = simulate_reports(run.scenario, resolve(parameters).radars, run.seed)
    begin = time.process_time()
    found = follow(reports, run.scenario.radars, [truth.stamp_ns for truth in run.truth])
    spent = time.process_time() - begin
    scored = without_ignored(run, found)
    return TrackingResult(dict.fromkeys(lags, scored), 1e3 * spent / max(len(run.truth), 1))
