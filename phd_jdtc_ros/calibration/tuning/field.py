"""A radar's coverage in range and azimuth, estimated from its plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.types import FULL_TURN

from .plots import Plots

# A field of view is proposed only if a gap in azimuth without plots is wider than this, radians.
LEAST_GAP = np.radians(20.0)
# The gap must also be wider than this many times the mean azimuth spacing of the plots.
LEAST_SPACES = 12.0
# Land clutter: a cell with plots in more than the share `AGAIN` of all looks, and in at least
# `LEAST_AGAIN` of them. A cell is `CELL_SIGMA` standard deviations wide in range and in azimuth.
AGAIN, LEAST_AGAIN, CELL_SIGMA = 0.15, 5.0, 3.0


@dataclass(frozen=True)
class Field:
    """A radar's coverage."""

    min_range: float  # Range of the nearest plot, metres
    max_range: float  # Range of the farthest plot, metres
    # Range up to which plots that belong to no track are uniform in range, metres.
    clutter_range: float
    # First azimuth and counter-clockwise width of the coverage, radians; None if plots are all
    # around.
    arc: tuple[float, float] | None


def elsewhere(plots: Plots, looks: float, range_std: float, azimuth_std: float) -> IntArray:
    """Return the plots outside land clutter, which recurs in the same cells of a stationary radar.

    The recording has `looks` turns or clouds; the standard deviations are those of a plot,
    metres and radians.
    """
    if np.ptp(plots.pose, axis=0).any():
        return np.arange(len(plots))
    row = np.floor(plots.measurement[:, 0] / (CELL_SIGMA * range_std))
    column = np.floor((plots.measurement[:, 1] + np.pi) / (CELL_SIGMA * azimuth_std))
    cell = row * np.ceil(FULL_TURN / (CELL_SIGMA * azimuth_std) + 1.0) + column
    _, place, count = np.unique(cell, return_inverse=True, return_counts=True)
    kept: IntArray = np.flatnonzero(count[place.ravel()] < max(AGAIN * looks, LEAST_AGAIN))
    return kept


def field_of(plots: Plots, claimed: IntArray) -> Field:
    """Return the coverage of the radar, from at least one plot.

    `claimed` has the indices of the plots that belong to a track.
    """
    distance, azimuth = plots.measurement.T
    free = np.setdiff1d(np.arange(len(plots)), claimed)
    clutter = float(distance.max())
    if len(free) > 1:
        # The largest of n uniform numbers is n / (n + 1) of their limit on average; a single plot
        # far beyond the others is ignored.
        farthest = float(np.quantile(distance[free], 1.0 - 1.0 / len(free)))
        clutter = min(farthest * (len(free) + 1.0) / len(free), clutter)
    start, width = smallest_arc(azimuth)
    gap = FULL_TURN - width
    partly = gap > LEAST_GAP and gap > LEAST_SPACES * width / len(plots)
    return Field(
        float(distance.min()), float(distance.max()), clutter, (start, width) if partly else None
    )
