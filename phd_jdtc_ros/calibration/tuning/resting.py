"""Whether what stays in its place is fixed clutter, or may be targets at rest.

Both return plots from the same places from the beginning of a recording to its end. Land, quays and
wind turbines are many beside few moving targets, and single ones of their echoes are often missed.
"""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .plots import Plots
from .rates import detection_probability, side_by_side
from .rotation import Timing
from .tracking.tracks import NoiseModel, Tracks

# A target has moved if its track is longer than this many standard deviations of a plot's position.
MOVED_SIGMA = 10.0
# The speed of slow targets: this quantile of the moving ones, each less SURE_SIGMA deviations.
SLOW, SURE_SIGMA = 0.1, 2.0
# Fixed clutter has at least this many times as many plots as the moving targets,
OUTNUMBERING = 5.0
# and its sources are detected with less than this share of the targets' probability, or a look has
# so many plots of them, this share of them with another one within the noise, that they cannot be
# targets. As many that stand apart may be moored boats.
SELDOM, MULTITUDE, SIDE_BY_SIDE = 0.8, 100.0, 0.5


def moving(plots: Plots, tracks: Tracks, noise: NoiseModel) -> tuple[Tracks, FloatArray]:
    """Return the tracks of targets that have moved, and the lower bounds of their speeds, m/s."""
    position, found, slowest = plots.position, [], []
    for own in tracks.plots:
        time_s = plots.time_s[own]
        off = time_s - time_s.mean()
        velocity = off @ (position[own] - position[own].mean(axis=0)) / (off @ off)
        across = plots.across(noise.azimuth_std, own)
        std, speed = max(noise.range_std, across), float(np.hypot(*velocity))
        if speed * np.ptp(time_s) > MOVED_SIGMA * std:
            found.append(own)
            slowest.append(speed - SURE_SIGMA * std / float(np.sqrt(off @ off)))
    return Tracks(tuple(found), tracks.score), np.array(slowest)


def slow_speed(
    plots: Plots, timing: Timing, tracks: Tracks, noise: NoiseModel, fixed: IntArray
) -> float:
    """Return the speed of slow targets, m/s, if the plots `fixed` are clearly clutter; otherwise 0.

    These are the plots in recurring places; without a moving target nothing is clear.
    """
    of_fixed = np.zeros(len(plots), dtype=np.bool_)
    of_fixed[fixed] = True
    others = tuple(own for own in tracks.plots if of_fixed[own].mean() < 0.5)
    movers, speeds = moving(plots, Tracks(others, tracks.score), noise)
    if not len(speeds) or len(fixed) < OUTNUMBERING * len(movers.claimed):
        return 0.0
    look = timing.looks(plots.time_s, plots.cloud.astype(np.float64))[fixed].astype(np.int64)
    count = np.bincount(look)
    # The number of plots of sources with one detection probability is binomial.
    probability = 1.0 - float(count.var() / count.mean())
    seldom = probability < SELDOM * detection_probability(plots, timing, movers).value
    apart = side_by_side(plots, timing, noise.range_std, noise.azimuth_std, fixed) < SIDE_BY_SIDE
    if not seldom and (count.mean() < MULTITUDE or apart):
        return 0.0
    return max(float(np.quantile(speeds, SLOW)), 0.0)
