# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two pictures: the smoother's cost against particles per target, and against targets."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from phd_jdtc_ros.report.style import COLOURS, DPI, GREY, INK, MARKERS, WIDTH_IN, plain_axes

from .backends import NUMBA, NUMPY

HEIGHT_IN = 5.2


class Look(NamedTuple):
    """The style and the label of a form."""

    label: str
    colour: str
    marker: str


LOOKS = {
    "dense": Look("dense, as the paper writes it", COLOURS[1], MARKERS[3]),
    "k-d tree": Look("k-d tree", COLOURS[4], MARKERS[2]),
    f"smoother [{NUMPY}]": Look("this package, NumPy", COLOURS[0], MARKERS[0]),
    f"smoother [{NUMBA}]": Look("this package, numba", COLOURS[2], MARKERS[1]),
    "limit": Look("limit: whiten, sort, gather", GREY, ""),
}
AXES = {
    "particles_per_target": ("particles per target", "{targets} targets"),
    "targets": ("targets", "{particles_per_target} particles per target"),
}


def write_all(growth: Mapping[str, Any], directory: Path) -> list[Path]:
    """Write both pictures as PNGs and return their paths."""
    paths = []
    for ladder, (label, fixed) in AXES.items():
        figure = cost(growth[ladder], label, fixed.format(**growth[ladder]))
        path = directory / f"cost_against_{ladder}.png"
        FigureCanvasAgg(figure).print_png(path)
        paths.append(path)
    return paths


def cost(ladder: Mapping[str, Any], label: str, fixed: str) -> Figure:
    """Draw the median cost of every form over one series of sizes, both axes logarithmic.

    A form's slope is the exponent of its growth; the dotted line is linear growth.
    """
    figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    axes.set_xscale("log")
    axes.set_yscale("log")
    handles = [
        _draw(axes, ladder["forms"][form], look)
        for form, look in LOOKS.items()
        if form in ladder["forms"]
    ]
    handles.append(_draw_linear(axes, ladder["forms"][f"smoother [{NUMPY}]"]))
    sizes = ladder["forms"]["limit"]["size"]
    axes.xaxis.set_major_locator(FixedLocator(sizes))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(f"{label} ({fixed})")
    axes.set_ylabel("CPU time of the smoother per scan (ms)")
    axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(handles=handles, loc="outside upper left", ncols=2, frameon=False)
    return figure


def _draw(axes: Axes, form: Mapping[str, Any], look: Look) -> Artist:
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
