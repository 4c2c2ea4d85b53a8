"""Detection probability and clutter rate, counted over tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray

from .plots import Plots
from .rotation import Timing
from .tracks import Tracks


@dataclass(frozen=True)
class Rate:
    """A figure with its standard deviation and the number of samples behind it."""

    value: float
    std: float
    count: int


def detection_probability(plots: Plots, timing: Timing, tracks: Tracks) -> Rate:
    """Return the share of looks with a detection between each track's first and last plot.

    These two plots do not count: a track exists only between them.
    """
    looks = hits = 0
    for own in tracks.plots:
        first, last = own[0], own[-1]
        elapsed = plots.time_s[last] - plots.time_s[first], plots.cloud[last] - plots.cloud[first]
        between = max(int(np.round(timing.looks(*elapsed))) - 1, 0)
        looks += between
        hits += min(len(own) - 2, between)
    # Laplace's rule: one hit and one miss are added.
    value = (hits + 1.0) / (looks + 2.0)
    return Rate(value, float(np.sqrt(value * (1.0 - value) / (looks + 3.0))), looks)


def looks_of(plots: Plots, timing: Timing) -> float:
    """Return the number of looks (turns or clouds) of a recording."""
    if not timing.rotation_s:
        return float(len(plots.cloud_s))
    whole = 0 if timing.sectors else 1
    part = timing.cloud_interval_s / timing.rotation_s if timing.sectors else 0.0
    return plots.duration_s / timing.rotation_s + whole + part


def clutter_rate(
    plots: Plots, timing: Timing, tracks: Tracks, rows: IntArray | None = None
) -> Rate:
    """Return the mean number of plots per look outside tracks; only of `rows` if these are given.

    The standard deviation is the larger of a Poisson count's and that between ten parts of the
    recording.
    """
    free = np.setdiff1d(np.arange(len(plots)) if rows is None else rows, tracks.claimed)
    looks = looks_of(plots, timing)
    value = len(free) / looks
    std = np.sqrt(max(len(free), 1.0)) / looks
    if looks >= 20.0:
        edges = np.linspace(0.0, plots.duration_s, 11)
        parts, _ = np.histogram(plots.time_s[free], edges)
        std = max(std, float(np.std(parts * 10.0 / looks)) / np.sqrt(10.0))
    return Rate(value, float(std), len(free))
