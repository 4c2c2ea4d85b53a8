"""Links plots to tracks by global nearest neighbour (GNN), and scores each track.

A track's score is the log likelihood ratio of its plots, target to clutter (Blackman and Popoli,
Sec. 6.2); the sum over all tracks measures how well a model of the noise explains a recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, read_only

from .plots import Plots
from .rotation import Timing

# Gate, in standard deviations.
GATE = 4.5
# A track is accepted with at least this many plots and this score.
LEAST_HITS, LEAST_SCORE = 5, 8.0
# A track ends when its misses are less probable than `IMPROBABLE`, within these bounds on their
# number.
IMPROBABLE, LEAST_MISSES, MOST_MISSES = 0.005, 3, 6


@dataclass(frozen=True)
class NoiseModel:
    """Measurement noise and process noise; of places the first two are those of x and y, metres."""

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
    # Numba is loaded with the loops when they are needed.
    from .linking import Columns, Numbers, link

    misses = np.log(IMPROBABLE) / np.log(max(1.0 - model.detection_probability, 1e-3))
    log_clutter = np.log(max(model.clutter_rate, 0.1) / _field_size(plots))
    numbers = Numbers(
        timing.rotation_s,
        float(np.clip(np.ceil(misses), LEAST_MISSES, MOST_MISSES)),
        read_only(model.variance),
        read_only(model.densities),
        GATE,
        LEAST_HITS,
        model.log_miss,
        float(np.log(model.detection_probability) - log_clutter - np.log(2.0 * np.pi)),
        plots.places,
    )
    count = len(plots)
    measured = plots.measurement, plots.pose
    values = (
        plots.time_s,
        plots.cloud.astype(np.float64),
        *measured,
        plots.position,
        log_ratio,
        *kinematics.initial_state(*measured, model.variance, model.speed_std, plots.places),
        np.arange(count),
        np.ones(count, dtype=np.int64),
        # Initial score of a track: the log prior that an unassociated plot is of a new target.
        -np.log(50.0) + log_ratio,
    )
    columns = Columns(*map(np.ascontiguousarray, values))
    added_to = link(*_batches(plots, timing), columns, numbers)
    track, plot = np.append(np.arange(count), added_to), np.tile(np.arange(count), 2)
    kept = (track >= 0) & (columns.hits[track] >= LEAST_HITS)
    order = np.flatnonzero(kept)[np.argsort(track[kept], kind="stable")]
    starts = np.flatnonzero(np.diff(track[order], prepend=-1))
    return _accepted(np.split(plot[order], starts[1:]), columns.score[track[order[starts]]])


def _field_size(plots: Plots) -> float:
    """Return the size of the field of view in units of a measurement."""
    if plots.places:
        return float(np.maximum(np.ptp(plots.measurement, axis=0), 1.0).prod())
    farthest = float(plots.measurement[:, 0].max(initial=1.0))
    return plots.fov * max(farthest - plots.min_range, 1e-3 * farthest)


def _accepted(tracks: list[IntArray], scores: FloatArray) -> Tracks:
    """Return the tracks that are accepted; a plot of two tracks goes to that of better score."""
    taken: set[int] = set()
    accepted, total = [], 0.0
    for index in np.argsort(-scores, kind="stable"):
        own = [plot for plot in tracks[index].tolist() if plot not in taken]
        # Least share of an accepted track's plots that belong to no better track.
        enough = len(own) >= max(LEAST_HITS, 0.7 * len(tracks[index]))
        if enough and scores[index] >= LEAST_SCORE:
            taken.update(own)
            accepted.append(np.array(own))
            total += float(scores[index])
    return Tracks(tuple(accepted), total)


def _batches(plots: Plots, timing: Timing) -> tuple[IntArray, IntArray]:
    """Return the plots batch by batch, and the first of each batch, and their number.

    Those of a batch are assigned together: those of a cloud, or of a share of a revolution.
    """
    number: FloatArray = plots.cloud.astype(np.float64)
    if timing.rotation_s:
        # Share of a revolution whose plots are assigned together.
        number = np.floor(plots.time_s / (1.0 / 12.0 * timing.rotation_s))
    order = np.argsort(number, kind="stable")
    edges = np.flatnonzero(np.diff(number[order], prepend=-np.inf))
    return order, np.append(edges, len(order))
