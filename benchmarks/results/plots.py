"""Pictures of growth: the smoother's cost against particles and targets, a step's of targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from phd_jdtc_ros.report.style import COLOURS, DPI, GREY, INK, MARKERS, WIDTH_IN, plain_axes

from ..engine.recursion import FAST, GAUSSIAN, PARTICLES

HEIGHT_IN = 5.2


class Look(NamedTuple):
    """The style and the label of a form."""

    label: str
    colour: str
    marker: str


LOOKS = {
    "dense": Look("dense, as the paper writes it", COLOURS[1], MARKERS[3]),
    "k-d tree": Look("k-d tree", COLOURS[4], MARKERS[2]),
    "smoother": Look("this package", COLOURS[0], MARKERS[0]),
    "limit": Look("limit: whiten, sort, gather", GREY, ""),
}
STEP_LOOKS = {
    PARTICLES: Look("particles", COLOURS[0], MARKERS[0]),
    GAUSSIAN: Look("Gaussian", COLOURS[1], MARKERS[3]),
    FAST: Look("Gaussian, accuracy fast", COLOURS[2], MARKERS[1]),
}
AXES = {
    "particles_per_target": ("particles per target", "{targets} targets"),
    "targets": ("targets", "{particles_per_target} particles per target"),
}


def write_all(summary: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write the pictures as PNGs and return their paths."""
    figures = {}
    if "growth" in summary:
        growth = summary["growth"]
        for ladder, (label, fixed) in AXES.items():
            figure = cost(growth[ladder], label, fixed.format(**growth[ladder]))
            figures[f"cost_against_{ladder}.png"] = figure
    if "step_growth" in summary:
        figures["step_against_targets.png"] = step_cost(summary["step_growth"])
    for name, figure in figures.items():
        FigureCanvasAgg(figure).print_png(directory / name)
    return [directory / name for name in figures]


def cost(ladder: Mapping[str, Any], label: str, fixed: str) -> Figure:
    """Draw the smoother's median cost in every form over one series of sizes; see `_growth`."""
    forms = ladder["forms"]
    figure, axes = _growth(forms, LOOKS, forms["smoother"], forms["limit"]["size"])
    axes.set_xlabel(f"{label} ({fixed})")
    axes.set_ylabel("CPU time of the smoother per scan (ms)")
    return figure


def step_cost(growth: Mapping[str, Any]) -> Figure:
    """Draw the median cost of a step of each engine over the targets; see `_growth`."""
    forms = growth["forms"]
    longest = forms[GAUSSIAN]
    figure, axes = _growth(forms, STEP_LOOKS, longest, longest["size"])
    axes.set_xlabel(f"targets ({growth['particles_per_target']} particles per target)")
    axes.set_ylabel("CPU time of a step, with smoothing (ms)")
    return figure


def _growth(
    forms: Mapping[str, Any],
    looks: Mapping[str, Look],
    reference: Mapping[str, Any],
    sizes: Sequence[float],
) -> tuple[Figure, Axes]:
    """Draw median costs, both axes logarithmic, in the order of their looks.

    A form's slope is the exponent of its growth; the dotted line is linear growth of `reference`.
    """
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    axes.set_xscale("log")
    axes.set_yscale("log")
    handles: list[Artist | ErrorbarContainer] = [
        _draw(axes, forms[form], look) for form, look in looks.items() if form in forms
    ]
    handles.append(_draw_linear(axes, reference))
    axes.xaxis.set_major_locator(FixedLocator(sizes))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(handles=handles, loc="outside upper left", ncols=2, frameon=False)
    return figure, axes


def _draw(axes: Axes, form: Mapping[str, Any], look: Look) -> ErrorbarContainer:
    """Draw one form's medians with their quartiles."""
    median = np.array([times["median_ms"] for times in form["times"]])
    low = median - [times["lower_quartile_ms"] for times in form["times"]]
    high = np.array([times["upper_quartile_ms"] for times in form["times"]]) - median
    slope = form["exponent"]
    return axes.errorbar(
        form["size"],
        median,
        yerr=[low, high],
        label=look.label if slope is None else f"{look.label} (slope {slope:.2f})",
        color=look.colour,
        marker=look.marker,
        linestyle="--" if not look.marker else "-",
        markersize=5,
        capsize=2.5,
    )


def _draw_linear(axes: Axes, form: Mapping[str, Any]) -> Artist:
    """Draw linear growth from the smallest size on."""
    size = np.array(form["size"], dtype=float)
    cost_ms = form["times"][0]["median_ms"] * size / size[0]
    (line,) = axes.plot(size, cost_ms, color=INK, linestyle=":", linewidth=1.0, label="linear")
    return line
