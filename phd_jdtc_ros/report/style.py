"""The style of all pictures: sizes, lines and markers of classes, and axes.

The palette suits colour-blind readers; lines and markers also differ in greyscale.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from msg_adapters.targets.markers import COLOURS as COLOURS
from msg_adapters.targets.markers import class_colour as class_colour
from phd_jdtc_ros import output_files
from phd_jdtc_ros.core.arrays import FloatArray

Line: TypeAlias = Literal["-", "--", "-.", ":"]

WIDTH_IN = 8.0
DPI = 150

LINES: tuple[Line, ...] = ("-", "--", "-.", ":")
MARKERS = ("o", "^", "s", "D", "v", "P")
# Colour of detections without amplitudes, on light and on dark pages.
DETECTION = "#807dba"
# Colour of learned clutter: red, green and blue.
CLUTTER = "176,118,42"
# Radius, in standard deviations, that contains 95 % of a two-dimensional Gaussian.
RADIUS_95 = float(np.sqrt(-2.0 * np.log(0.05)))
INK, GREY, FAINT = "#222222", "#9A9A9A", "#E4E4E4"


def purples(weak: float, strong: float, steps: int) -> FloatArray:
    """Return shades for amplitudes, in a hue that differs from all classes; shape (steps, 4).

    `weak` and `strong` are the darkness of low and of high amplitudes, from 0 (white) to 1.
    """
    return colormaps["Purples"](np.linspace(weak, strong, steps))


def class_line(class_id: int) -> Line:
    """Return the line style of a class."""
    return LINES[class_id % len(LINES)]


def class_marker(class_id: int) -> str:
    """Return the marker of a class."""
    return MARKERS[class_id % len(MARKERS)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file."""
    image = io.BytesIO()
    FigureCanvasAgg(figure).print_png(image)
    output_files.write(path, image.getvalue())


def plain_axes(axes: Axes) -> None:
    """Reduce the axes to two spines and a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def rows_over_time(
    rows: int, label: str, time_label: str, span: float
) -> tuple[Figure, list[Axes]]:
    """Return rows of axes that share both scales, over a span of time."""
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 1.75 * rows), dpi=DPI, layout="constrained")
    column = list(figure.subplots(rows, 1, sharex=True, sharey=True, squeeze=False)[:, 0])
    for axes in column:
        plain_axes(axes)
        axes.set_ylabel(label)
    column[-1].set_xlabel(time_label)
    column[-1].set_xlim(-0.01 * span, 1.01 * span)
    return figure, column


def row_header(axes: Axes, title: str) -> None:
    """Place the row's title and its legend above it."""
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncol=2,
            frameon=False,
            fontsize=9,
            borderaxespad=0.1,
        )
