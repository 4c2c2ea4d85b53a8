"""Amplitudes and ranges: target-to-clutter likelihood ratios, the threshold, clutter levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.factors import ClutterRanges
from phd_jdtc_ros.core.targets.amplitude_density import level_db

from .plots import Plots
from .tracks import Tracks

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
        with np.errstate(divide="ignore"):  # amplitudes of zero are -inf dB
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
