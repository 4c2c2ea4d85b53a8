"""Where a radar's plots are: how far it sees, and in which directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.types import FULL_TURN

from .plots import Plots

# Azimuths are not a field of view if no part of a turn of this width is without plots, radians.
LEAST_GAP = np.radians(20.0)
# Nor if a gap is not wider than this many times the mean distance of plots.
LEAST_SPACES = 12.0
# Land answers at a place in more than this share of all looks, and so many times at least; places
# are so many deviations wide.
AGAIN, LEAST_AGAIN, CELL_SIGMA = 0.15, 5.0, 3.0


@dataclass(frozen=True)
class Field:
    """Where plots are.

    Parameters
    ----------
    min_range, max_range : float
        Of the nearest and the farthest plot, metres.
    clutter_range : float
        Range up to which plots that no track has are uniform in range, metres.
    arc : tuple of two floats or None
        Where the azimuths begin and how far they extend counter-clockwise, radians; None if there
        are plots all around.
    """

    min_range: float
    max_range: float
    clutter_range: float
    arc: tuple[float, float] | None


def elsewhere(plots: Plots, looks: float, range_std: float, azimuth_std: float) -> IntArray:
    """Return the plots that are not where a radar that stands has plots again and again.

    Parameters
    ----------
    plots : Plots
    looks : float
    range_std, azimuth_std : float
        Metres and radians.
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
    """Return where plots are.

    Parameters
    ----------
    plots : Plots
        At least one.
    claimed : int array
        Indices of the plots that a track has.
    """
    distance, azimuth = plots.measurement.T
    free = np.setdiff1d(np.arange(len(plots)), claimed)
    clutter = float(distance.max())
    if len(free) > 1:
        # Of n uniform numbers, the largest is n / (n + 1) of the limit on average; a single plot
        # far beyond the others is left out.
        farthest = float(np.quantile(distance[free], 1.0 - 1.0 / len(free)))
        clutter = min(farthest * (len(free) + 1.0) / len(free), clutter)
    start, width = smallest_arc(azimuth)
    gap = FULL_TURN - width
    partly = gap > LEAST_GAP and gap > LEAST_SPACES * width / len(plots)
    return Field(
        float(distance.min()), float(distance.max()), clutter, (start, width) if partly else None
    )
