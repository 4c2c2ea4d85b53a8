"""Links plots to tracks by global nearest neighbour (GNN), scores tracks, and makes a first guess.

A track's score is the log likelihood ratio of its plots, target to clutter (Blackman and Popoli,
Sec. 6.2); the sum over all tracks measures how well a model of the noise explains a recording. The
ratio of amplitudes and ranges follows from earlier tracks. The first guess of noise and speeds is
that of a grid that explains a recording best: all are compared on a part of the recording, and the
best few on the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, read_only
from phd_jdtc_ros.core.factors import ClutterRanges
from phd_jdtc_ros.core.targets.amplitude_density import level_db

from .plots import Plots, Timing

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


# Histogram of levels: lower end of the first cell and width of a cell, dB, and pseudo-count of
# each cell.
LOWEST_DB, CELL_DB, PRIOR = -40.0, 3.0, 1.0
# Bound of an amplitude's absolute log likelihood ratio.
MOST = 4.0


@dataclass(frozen=True)
class Levels:
    """The amplitudes of a radar."""

    threshold: float  # The lowest envelope
    # Mean of (a^2 - threshold^2) / 2 over clutter, estimated by its median; 1 for noise.
    excess: float
    # The 5 % and 95 % quantile of the tracks' mean levels as SNRs, dB; both NaN without tracks.
    target_db: tuple[float, float]
    clutter: int  # Number of plots of clutter
    targets: int  # Number of plots of targets

    @property
    def false_alarm_probability(self) -> float:
        """Probability that noise exceeds the threshold."""
        return float(np.exp(-0.5 * self.threshold**2))

    @property
    def noise_is_known(self) -> bool:
        """Whether this is plausible for a receiver; otherwise the noise level is unknown."""
        return 1e-12 <= self.false_alarm_probability <= 0.5


def levels(plots: Plots, tracks: Tracks) -> Levels | None:
    """Return the amplitudes' statistics; None without amplitudes."""
    if plots.amplitude is None or not np.isfinite(plots.amplitude).any():
        return None
    amplitude = plots.amplitude
    known = np.isfinite(amplitude)
    free = np.setdiff1d(np.flatnonzero(known), tracks.claimed)
    threshold = float(amplitude[known].min())
    excess = 0.5 * (amplitude[free] ** 2 - threshold**2)
    means = [np.nanmean(0.5 * amplitude[own] ** 2) for own in tracks.plots if known[own].any()]
    quantiles = (np.nan, np.nan)
    if means:
        with np.errstate(divide="ignore"):  # Amplitudes of zero are -inf dB.
            low, high = 10.0 * np.log10(np.quantile(means, [0.05, 0.95]))
        quantiles = float(low), float(high)
    return Levels(
        threshold,
        float(np.median(excess) / np.log(2.0)) if len(free) else np.nan,
        quantiles,
        len(free),
        int(np.count_nonzero(known[tracks.claimed])),
    )


def log_ratio(plots: Plots, linked: Plots, tracks: Tracks) -> FloatArray:
    """Return the log likelihood ratio of each plot's amplitude, target to clutter, shape (N,).

    Both densities are histograms: of the plots in tracks, and of the other plots. `linked` has the
    plots from which `tracks` were made: `plots`, or a part of them.
    """
    ratio = np.zeros(len(plots))
    if plots.amplitude is None or linked.amplitude is None:
        return ratio
    known = np.flatnonzero(np.isfinite(linked.amplitude))
    claimed = np.intersect1d(known, tracks.claimed)
    free = np.setdiff1d(known, claimed)
    # Fewest plots of targets, and of clutter, for which amplitudes are used.
    if min(len(claimed), len(free)) < 30:
        return ratio
    cell = _cells(linked.amplitude)
    cells = int(cell.max()) + 1
    of_targets = np.bincount(cell[claimed], minlength=cells) + PRIOR
    of_clutter = np.bincount(cell[free], minlength=cells) + PRIOR
    log_ratio_of_cell = np.log(of_targets / of_targets.sum()) - np.log(
        of_clutter / of_clutter.sum()
    )
    log_ratio_of_cell = np.clip(log_ratio_of_cell, -MOST, MOST)
    reported = np.flatnonzero(np.isfinite(plots.amplitude))
    cell = np.minimum(_cells(plots.amplitude[reported]), cells - 1)
    ratio[reported] = log_ratio_of_cell[cell]
    return ratio


def clutter_ranges(plots: Plots, free: IntArray) -> ClutterRanges:
    """Return the law over range of false plots, given their indices."""
    farthest = float(plots.measurement[:, 0].max(initial=1.0))
    nearest = plots.min_range if plots.min_range < farthest else 0.0
    law = ClutterRanges.of_table(True, (nearest, farthest), ((), ()))
    return law.after(plots.measurement[free, 0], np.ones(len(free)))


def log_target_ratio(plots: Plots, linked: Plots, tracks: Tracks) -> FloatArray:
    """Return the log likelihood ratio of amplitudes and ranges, target to clutter, (N,).

    The ranges of targets are uniform; for the arguments see `log_ratio`.
    """
    ratio = log_ratio(plots, linked, tracks)
    if not plots.places:
        free = np.setdiff1d(np.arange(len(linked)), tracks.claimed)
        ratio -= clutter_ranges(linked, free).log_ratio(plots.measurement[:, 0])
    return ratio


def _cells(amplitude: FloatArray) -> IntArray:
    """Return the cell of each envelope; 0 where it is unknown."""
    level = level_db(np.maximum(np.nan_to_num(amplitude), 1e-6))
    cell: IntArray = np.maximum(np.floor((level - LOWEST_DB) / CELL_DB), 0.0).astype(np.int64)
    return cell


# Grid of the targets' speeds, metres per second: first the usual one, then the others.
USUAL_SPEED, SPEEDS = 40.0, (8.0, 160.0)
# Number of the best noise guesses that are combined with every speed.
BEST = 3
# Guesses are compared on the first LOOKS looks of a recording, or on fewer, at least LEAST_LOOKS,
# if these have more than PLOTS plots.
LOOKS, PLOTS, LEAST_LOOKS = 24, 1000, 10.0


def guess_of(
    plots: Plots, timing: Timing, range_std: float, azimuth_std: float, speed_std: float
) -> LinkModel:
    """Return a guess with process noise that matches its measurement noise."""
    across = plots.across(azimuth_std, np.arange(len(plots)))
    position = min(range_std, across) if across > 0.0 else range_std
    looks = plots.duration_s / timing.look_s + 1.0
    # Displacement by a manoeuvre between two looks, in standard deviations of a plot's position.
    density = float(3.0 * (0.5 * position) ** 2 / timing.look_s**3)
    return LinkModel(
        range_std=range_std,
        azimuth_std=azimuth_std,
        densities=(0.1 * density, density),
        speed_std=speed_std,
        # Assumed detection probability before any estimate.
        detection_probability=0.85,
        clutter_rate=len(plots) / looks,
    )


def first_guess(plots: Plots, timing: Timing) -> tuple[LinkModel, Tracks]:
    """Return the guess whose tracks have the best score, and its tracks; at least one plot."""
    per_look = len(plots) / (plots.duration_s / timing.look_s + 1.0)
    looks = min(LOOKS, max(PLOTS / max(per_look, 1.0), LEAST_LOOKS))
    while True:
        part = plots.until(looks * timing.look_s)
        part = part if len(part) else plots
        best = _best_of_grid(part, timing)
        # Amid much clutter, the first targets may come later than in the first looks.
        if best[0][0].plots or len(part) == len(plots):
            break
        looks *= 2.0
    whole = [
        (link_plots(plots, timing, guess, log_target_ratio(plots, part, tracks)), guess)
        for tracks, guess in best
    ]
    tracks, guess = max(whole, key=_score)
    return guess, tracks


def _best_of_grid(plots: Plots, timing: Timing) -> list[tuple[Tracks, LinkModel]]:
    """Return the guesses that explain plots best, and their tracks, by descending score."""
    # Places may be of people.
    noises, speeds = _noises(plots), (2.0, 8.0, 160.0) if plots.places else SPEEDS
    ratio = log_target_ratio(plots, plots, Tracks((), 0.0))

    def link(noise: tuple[float, float], speed: float) -> tuple[Tracks, LinkModel]:
        guess = guess_of(plots, timing, *noise, speed)
        return link_plots(plots, timing, guess, ratio), guess

    first = sorted((link(noise, USUAL_SPEED) for noise in noises), key=_score, reverse=True)
    best = first[:BEST]
    best += [
        link((guess.range_std, guess.azimuth_std), speed)
        for _, guess in first[:BEST]
        for speed in speeds
    ]
    return sorted(best, key=_score, reverse=True)[:BEST]


def _noises(plots: Plots) -> list[tuple[float, float]]:
    """Return the grid of both standard deviations; those of places are equal and fill the area."""
    # Deviations of the range are shares of the farthest plot's range.
    ranges = (2.5e-4, 1e-3, 4e-3, 1.6e-2)
    azimuths_deg = (0.06, 0.25, 1.0, 4.0)
    if plots.places:
        middle = np.median(plots.measurement, axis=0)
        reach = float(np.quantile(np.abs(plots.measurement - middle).max(axis=1), 0.99))
        return [(share * max(reach, 1.0),) * 2 for share in ranges]
    farthest = float(np.quantile(plots.measurement[:, 0], 0.99))
    return [
        (share * farthest, float(np.radians(deg))) for share, deg in product(ranges, azimuths_deg)
    ]


def _score(found: tuple[Tracks, LinkModel]) -> float:
    return found[0].score
