"""The picture of a registration: residuals of plots over time, before and after it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phd_jdtc_ros.calibration.registration.solution import RadarEstimate, Registration
from phd_jdtc_ros.core.arrays import FloatArray

from .style import DPI, GREY, INK, WIDTH_IN, class_colour, plain_axes

# Rows of axes: name, unit and scale of the residual.
ROWS = (("range", "m", 1.0), ("azimuth, left", "degrees", float(np.degrees(1.0))))
# Number of equal parts of the time, each with its mean drawn.
PARTS = 20


def draw(found: Registration) -> Figure:
    """Draw the residuals of plots to their targets over time, before and after registration."""
    count = len(found.radars)
    width = max(WIDTH_IN, 2.7 * count)
    figure = Figure(figsize=(width, 5.0), dpi=DPI, layout="constrained")
    grid = figure.subplots(len(ROWS), count, sharex=True, sharey="row", squeeze=False)
    longest = max(float(np.ptp(each.residuals.time_s)) for each in found.radars)
    unit_s, unit = (60.0, "min") if longest > 300.0 else (1.0, "s")
    begin = min(float(each.residuals.time_s.min()) for each in found.radars)
    for row, (what, of_unit, scale) in enumerate(ROWS):
        bound = max(_bound(each, row) for each in found.radars) * scale
        for axes, each in zip(grid[row], found.radars, strict=True):
            _draw_axes(axes, each, row, scale, begin, unit_s)
            axes.set_ylim(-bound, bound)
        grid[row, 0].set_ylabel(f"{what}, {of_unit}")
    for axes, each in zip(grid[0], found.radars, strict=True):
        axes.set_title(each.name, loc="left", fontsize=10, color=INK)
    for axes in grid[-1]:
        axes.set_xlabel(f"time, {unit}")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=8,
        markerscale=5.0,
    )
    figure.suptitle("Plots less targets as all radars see them", x=0.01, ha="left", fontsize=11)
    return figure


def _bound(found: RadarEstimate, axis: int) -> float:
    both = np.abs([found.residuals.before[:, axis], found.residuals.after[:, axis]])
    # Quantile of the absolute residuals that sets the limits of the axes.
    return float(1.15 * np.quantile(both, 0.99, axis=1).max())


def _draw_axes(
    axes: Axes, found: RadarEstimate, axis: int, scale: float, begin: float, unit_s: float
) -> None:
    own = found.residuals
    time = (own.time_s - begin) / unit_s
    # Largest number of drawn plots of a radar; a regular subset is drawn if there are more.
    chosen = slice(None, None, max(1, len(time) // 3000))
    series = ((own.before, GREY, "before"), (own.after, class_colour(0), "after"))
    plain_axes(axes)
    for error, colour, label in series:
        value = scale * error[:, axis]
        axes.plot(
            time[chosen], value[chosen], ".", markersize=1.5, color=colour, alpha=0.35,
            label=f"{label}, plots", zorder=2,
        )  # fmt: skip
    for error, colour, label in series:
        middle, mean = _means(time, scale * error[:, axis])
        style = "--" if label == "before" else "-"
        ink = INK if label == "before" else colour
        axes.plot(middle, mean, style, linewidth=1.6, color=ink, label=f"{label}, mean", zorder=3)


def _means(time: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles of equal parts of the time, and the mean of each part."""
    edges = np.linspace(time.min(), time.max() + 1e-9, PARTS + 1)
    count, _ = np.histogram(time, edges)
    total, _ = np.histogram(time, edges, weights=value)
    some = count > 0
    middle = 0.5 * (edges[:-1] + edges[1:])
    return middle[some], total[some] / count[some]
