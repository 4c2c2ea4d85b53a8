"""Copies of plots: at a constant distance in the same look, or at the same place in a later one.

A copy has the errors of its plot, which no plot of another target or look has: where many
differences of plots agree far better than independent errors allow, each plot was recorded twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from phd_jdtc_ros.core.arrays import FloatArray, IntArray

from .noise import least_std
from .plots import Plots
from .rotation import Timing

# Differences agree within this share of a plot's standard deviation.
AGREE = 0.1
# Distances of copies in the same look, in standard deviations of a plot: nearer ones are merged
# whatever they are (see `rates.beside`), and farther ones are not searched for.
NEAREST, FARTHEST = np.sqrt(2.0), 20.0
# Largest delay of a copy, and largest difference of times in one look, in looks.
LATEST, SAME = 2.5, 0.5


@dataclass(frozen=True)
class Copies:
    """Copies of plots."""

    distance: float  # Of a copy in the same look, metres; 0 for later copies
    delay_s: float  # Of a later copy, seconds; 0 in the same look
    rows: IntArray  # Indices of the copies


def find_copies(plots: Plots, timing: Timing, std: float) -> Copies | None:
    """Return the copies among plots of a standard deviation, metres; None without enough.

    There are none where plots have hardly any error, or are rounded as coarsely as they err.
    """
    if std < 10.0 * least_std(plots.places)[0] or _is_rounded(plots.measurement[:, 0], std):
        return None
    of_plots = plots.position, plots.time_s, timing, std
    return _beside(*of_plots) or _later(*of_plots)


def _is_rounded(value: FloatArray, std: float) -> bool:
    """Return whether values have a step that is no smaller than differences that agree."""
    steps = np.diff(np.unique(value))
    return not len(steps) or bool(steps.min() > 0.5 * AGREE * std)


def _beside(place: FloatArray, time_s: FloatArray, timing: Timing, std: float) -> Copies | None:
    """Return the copies in the same look, all at one distance and in one direction."""
    scaled = np.column_stack([place / (FARTHEST * std), time_s / (SAME * timing.look_s)])
    pairs = cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])  # Either one may be the copy
    difference = place[pairs[:, 1]] - place[pairs[:, 0]]
    far = np.hypot(*difference.T) > NEAREST * std
    pairs, difference = pairs[far], difference[far]
    if not len(pairs):
        return None
    cells = np.floor(difference / (AGREE * std))
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    middle = difference[cell.reshape(-1) == np.argmax(count)].mean(axis=0)
    agree = np.hypot(*(difference - middle).T) < AGREE * std
    return _if_many(Copies(float(np.hypot(*middle)), 0.0, np.unique(pairs[agree, 1])), len(place))


def _later(place: FloatArray, time_s: FloatArray, timing: Timing, std: float) -> Copies | None:
    """Return the copies at the places of their plots in later looks."""
    scaled = np.column_stack([place / (AGREE * std), time_s / (LATEST * timing.look_s)])
    pairs = np.sort(cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray"), axis=1)
    delay_s = time_s[pairs[:, 1]] - time_s[pairs[:, 0]]
    pairs, delay_s = pairs[delay_s > SAME * timing.look_s], delay_s[delay_s > SAME * timing.look_s]
    # What rests may be at one place in many looks; a copy is there twice.
    first, second = pairs.T
    alone = ~np.isin(first, second) & ~np.isin(second, first)
    if not alone.any():
        return None
    copies = Copies(0.0, float(np.median(delay_s[alone])), np.unique(second[alone]))
    return _if_many(copies, len(place))


def _if_many(found: Copies, plots: int) -> Copies | None:
    # Copies are found if at least this share of the plots is of copies and of what they copy.
    return found if 2 * len(found.rows) >= 0.5 * plots else None
