"""How an antenna turns, by the azimuths and times of its detections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.intake.antenna import SHORTEST_S
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.types import FULL_TURN

from .plot_turns import PlotTurns
from .plots import Plots

# For so much of a recording the antenna must have been followed, or it does not turn.
LEAST_FOLLOWED = 0.25


@dataclass(frozen=True)
class Timing:
    """When a radar looks.

    Parameters
    ----------
    cloud_interval_s : float
        Median time between clouds, seconds.
    interval_spread_s : float
        Median deviation of these times from it, seconds.
    rotation_s : float
        Time of one turn; 0 if the antenna does not turn, or not as far as the plots tell.
    rotation_std_s : float
        Standard deviation of the turns' mean, seconds.
    sectors : int
        Clouds to a turn; 0 if a cloud is a whole turn.
    clockwise : bool
        Whether it turns clockwise.
    timed : bool
        Whether plots have times of their own, so that clouds may be of any length.
    """

    cloud_interval_s: float
    interval_spread_s: float
    rotation_s: float = 0.0
    rotation_std_s: float = 0.0
    sectors: int = 0
    clockwise: bool = False
    timed: bool = False

    @property
    def look_s(self) -> float:
        """Time between two chances to detect a target, seconds."""
        return self.rotation_s or self.cloud_interval_s


def timing(plots: Plots) -> Timing:
    """Return when a radar looked.

    Parameters
    ----------
    plots : Plots
        Of at least two clouds.
    """
    steps = np.diff(plots.cloud_s)
    interval_s = float(np.median(steps))
    spread_s = float(np.median(np.abs(steps - interval_s)))
    still = Timing(interval_s, spread_s)
    if interval_s <= 0.0:
        return still
    clouds = _by_cloud(plots)
    azimuth = plots.measurement[:, 1] + plots.pose[:, 2]
    # Without times of their own, plots say something of turns that take two clouds or more: each
    # is somewhere in its cloud's sector.
    turns = PlotTurns(max(SHORTEST_S, interval_s * (0.8 if plots.timed else 1.9)))
    if not plots.timed:
        for rows in clouds:
            start, width = smallest_arc(azimuth[rows])
            azimuth[rows] = start + 0.5 * width
    for time_s, own in zip(plots.time_s, azimuth, strict=True):
        turns.add(float(own), round(time_s * 1e9))
    turns.find()
    if turns.counted_s < LEAST_FOLLOWED * plots.duration_s:
        return still
    sectors = round(turns.turn_s / interval_s)
    narrow = 1.5 * FULL_TURN / max(sectors, 1)
    widths = [smallest_arc(plots.measurement[rows, 1])[1] for rows in clouds if len(rows) > 1]
    return Timing(
        interval_s,
        spread_s,
        turns.turn_s,
        turns.turn_std_s,
        sectors if sectors > 1 and (not widths or float(np.median(widths)) < narrow) else 0,
        turns.clockwise,
        plots.timed,
    )


def _by_cloud(plots: Plots) -> list[IntArray]:
    """Return the rows of the plots of each cloud that has any."""
    order = np.argsort(plots.cloud, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(plots.cloud[order])) + 1) if len(plots) else []
