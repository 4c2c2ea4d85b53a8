"""Reliability diagrams: the said probability against the share that is right, with the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phd_jdtc_ros.report.style import COLOURS, DPI, FAINT, INK, MARKERS, WIDTH_IN, plain_axes

from .scores import Bins

# Largest difference that is a goal, and the number of statements of a bin that has the goal.
TOLERANCE, ENOUGH = 0.05, 200


def draw(
    rows: Mapping[str, Mapping[str, Bins]],
    edges: Mapping[str, Sequence[float]],
    tolerance: float = TOLERANCE,
) -> Figure:
    """Draw one diagram for each kind of probability, above the numbers of its statements.

    The bins are by kind of probability and by source, their edges by kind.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.4), dpi=DPI, layout="constrained")
    grid = figure.subplots(2, len(rows), height_ratios=[3.2, 1.0], sharex="col", squeeze=False)
    for (upper, lower), (kind, sources) in zip(grid.T, rows.items(), strict=True):
        low = edges[kind][0] if edges[kind][0] >= TOLERANCE else 0.0
        _diagonal(upper, low, tolerance)
        for index, (source, bins) in enumerate(sources.items()):
            _source(upper, lower, bins, source, index, edges[kind])
        upper.set(title=f"{kind} probability", ylabel="share that is right")
        upper.title.set_size(10)
        upper.set_ylim(top=1.06)
        upper.set_xlim(low - 0.02 * (1.0 - low), 1.0 + 0.02 * (1.0 - low))
        lower.set(xlabel="said by the tracker", ylabel="statements", yscale="log")
        lower.axhline(ENOUGH, color=INK, linewidth=0.7, linestyle=":")
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncol=4, frameon=False, fontsize=9)
    return figure


def _diagonal(axes: Axes, low: float, tolerance: float) -> None:
    """Draw the line of right probabilities in the band of the goal."""
    plain_axes(axes)
    ends = np.array([low, 1.0])
    label = f"goal: ± {tolerance:g}"
    axes.fill_between(
        ends, ends - tolerance, ends + tolerance, color=FAINT, linewidth=0, label=label
    )
    axes.plot(ends, ends, color=INK, linewidth=0.8)


def _source(
    upper: Axes, lower: Axes, bins: Bins, name: str, index: int, edges: Sequence[float]
) -> None:
    """Draw the bins of one source; those of few statements are hollow."""
    plain_axes(lower)
    colour, known = COLOURS[index], bins.number > 0
    many = bins.number >= ENOUGH
    # Neighbouring intervals do not hide each other.
    place = bins.said + (index - 0.5) * 0.008 * (1.0 - edges[0])
    around = np.stack([bins.right - bins.low, bins.high - bins.right])
    upper.errorbar(
        place[known],
        bins.right[known],
        yerr=np.maximum(around[:, known], 0.0),
        linestyle="none",
        color=colour,
        elinewidth=1.0,
        capsize=2.0,
    )
    for rows, face, label in ((known & many, colour, name), (known & ~many, "white", None)):
        upper.plot(
            place[rows],
            bins.right[rows],
            linestyle="none",
            marker=MARKERS[index],
            markersize=5.5,
            color=colour,
            markerfacecolor=face,
            label=label,
        )
    lower.stairs(np.maximum(bins.number, 0.5), edges, color=colour, linewidth=1.4)
