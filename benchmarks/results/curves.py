"""A picture of growth: the cost of a step against the number of targets."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from phd_jdtc_ros.report.style import COLOURS, DPI, INK, MARKERS, WIDTH_IN, plain_axes

from ..engine.recursion import FAST, GAUSSIAN

HEIGHT_IN = 5.2


class Look(NamedTuple):
    """The style and the label of a form."""

    label: str
    colour: str
    marker: str


STEP_LOOKS = {
    GAUSSIAN: Look("accuracy normal", COLOURS[1], MARKERS[3]),
    FAST: Look("accuracy fast", COLOURS[2], MARKERS[1]),
}


def write_all(summary: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write the pictures as PNGs and return their paths."""
    if "step_growth" not in summary:
        return []
    path = directory / "step_against_targets.png"
    FigureCanvasAgg(step_cost(summary["step_growth"])).print_png(path)
    return [path]


def step_cost(growth: Mapping[str, Any]) -> Figure:
    """Draw the median cost of a step of each form over the targets, both axes logarithmic.

    A form's slope is the exponent of its growth; the dotted line is linear growth.
    """
    forms, reference = growth["forms"], growth["forms"][GAUSSIAN]
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    axes.set_xscale("log")
    axes.set_yscale("log")
    handles: list[Artist | ErrorbarContainer] = [
        _draw(axes, forms[form], look) for form, look in STEP_LOOKS.items()
    ]
    handles.append(_draw_linear(axes, reference))
    axes.set_xlabel("targets")
    axes.set_ylabel("CPU time of a step, with smoothing (ms)")
    axes.xaxis.set_major_locator(FixedLocator(reference["size"]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(handles=handles, loc="outside upper left", ncols=2, frameon=False)
    return figure


def _draw(axes: Axes, form: Mapping[str, Any], look: Look) -> ErrorbarContainer:
    """Draw one form's medians with their quartiles."""
    median = np.array([times["median_ms"] for times in form["times"]])
    low = median - [times["lower_quartile_ms"] for times in form["times"]]
    high = np.array([times["upper_quartile_ms"] for times in form["times"]]) - median
    return axes.errorbar(
        form["size"],
        median,
        yerr=[low, high],
        label=f"{look.label} (slope {form['exponent']:.2f})",
        color=look.colour,
        marker=look.marker,
        markersize=5,
        capsize=2.5,
    )


def _draw_linear(axes: Axes, form: Mapping[str, Any]) -> Artist:
    """Draw linear growth from the smallest size on."""
    size = np.array(form["size"], dtype=float)
    cost_ms = form["times"][0]["median_ms"] * size / size[0]
    (line,) = axes.plot(size, cost_ms, color=INK, linestyle=":", linewidth=1.0, label="linear")
    return line
