"""Detection probability and clutter rate, counted over tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

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

    Notes
    -----
    The first and the last plot do not count: a track exists only between them.
    """
    chances = hits = 0
    for own in tracks.plots:
        looks = int(looks_between(plots, timing, np.array([own[0]]), np.array([own[-1]]))[0])
        chances += max(looks - 1, 0)
        hits += min(len(own) - 2, max(looks - 1, 0))
    # Laplace's rule: one hit and one miss are added.
    value = (hits + 1.0) / (chances + 2.0)
    return Rate(value, float(np.sqrt(value * (1.0 - value) / (chances + 3.0))), chances)


def looks_between(plots: Plots, timing: Timing, first: FloatArray, last: FloatArray) -> FloatArray:
    """Return the number of looks between pairs of plots, given by index; same shape."""
    if timing.rotation_s:
        turns = (plots.time_s[last] - plots.time_s[first]) / timing.rotation_s
        looks: FloatArray = np.round(turns)
        return looks
    clouds: FloatArray = (plots.cloud[last] - plots.cloud[first]).astype(np.float64)
    return clouds


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
