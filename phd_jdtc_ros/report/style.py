"""The style of pictures: sizes, lines and markers of classes, axes, and units of times and lengths.

The palette suits colour-blind readers; lines and markers also differ in greyscale.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from msg_adapters.targets.markers import COLOURS as COLOURS
from msg_adapters.targets.markers import class_colour as class_colour
from phd_jdtc_ros import output_files
from phd_jdtc_ros.core.arrays import FloatArray

from .record import Record, concatenate_rows

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
    """Return the marker of a class; they repeat where there are more classes."""
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


# Maps with a smaller extent than this are in metres.
SHORT_M = 2000.0


@dataclass(frozen=True)
class Clock:
    """Converts stamps to the time since a run's first stamp."""

    origin_ns: int
    span_s: float

    @staticmethod
    def of(record: Record) -> Clock:
        """Return the clock that starts with the record's first stamp."""
        parts: tuple[Iterable[Any], ...] = (
            record.truth,
            record.plots,
            record.filtered,
            record.smoothed,
        )
        stamps = [item.stamp_ns for part in parts for item in part]
        if not stamps:
            return Clock(0, 0.0)
        return Clock(min(stamps), (max(stamps) - min(stamps)) * 1e-9)

    @property
    def begin(self) -> str:
        """Date and time of the first stamp, UTC; empty if stamps do not count from 1970."""
        # Stamps from this one on, of 2001, count from 1970, and earlier ones from the start of
        # something.
        if self.origin_ns < 10**18:
            return ""
        begin = datetime.fromtimestamp(self.origin_ns // 10**9, timezone.utc)
        return f"{begin:%Y-%m-%d %H:%M:%S} UTC"

    @property
    def unit(self) -> str:
        """The unit: ``s``, or ``min`` for runs of more than half an hour."""
        return "s" if self.span_s <= 1800.0 else "min"

    @property
    def unit_s(self) -> float:
        """Length of the unit, seconds."""
        return 1.0 if self.unit == "s" else 60.0

    def seconds(self, stamp_ns: Sequence[int]) -> FloatArray:
        """Return seconds from the origin; the difference is taken in integers."""
        elapsed_ns = np.array([stamp - self.origin_ns for stamp in stamp_ns], dtype=np.int64)
        return elapsed_ns.astype(float) * 1e-9

    def number(self, seconds: float) -> str:
        """Return a time without its unit."""
        return f"{round(seconds / self.unit_s, 1):g}"

    def text(self, seconds: float) -> str:
        """Return a time with its unit."""
        return f"{self.number(seconds)} {self.unit}"

    def interval(self, first_s: float, last_s: float) -> str:
        """Return two times with their unit."""
        return f"{self.number(first_s)} to {self.text(last_s)}"


@dataclass(frozen=True)
class MapScale:
    """The unit of maps and of the lengths on them."""

    unit: str
    metres: float  # Length of the unit

    @staticmethod
    def of(record: Record) -> MapScale:
        """Return the scale that suits the positions of a record."""
        places = places_of(record)
        return MapScale.of_extent(float(np.ptp(places, axis=0).max()) if len(places) else SHORT_M)

    @staticmethod
    def of_extent(extent: float) -> MapScale:
        """Return the scale that suits an extent, metres."""
        return MapScale("m", 1.0) if extent < SHORT_M else MapScale("km", 1e3)

    def of_metres(self, metres: FloatArray) -> FloatArray:
        """Return lengths or positions in the unit."""
        return metres / self.metres


def places_of(record: Record) -> FloatArray:
    """Return the positions of targets and estimates, or else of detections, (N, 2), metres."""
    parts = (record.truth, record.filtered, record.smoothed)
    targets = concatenate_rows((entry.position for part in parts for entry in part), 2)
    return targets if len(targets) else record.all_plots.position


def round_step(least: float, digits: tuple[float, ...] = (1.0, 2.0, 5.0)) -> float:
    """Return the least product of a digit and a power of ten that is not below `least`."""
    decade = 10.0 ** np.floor(np.log10(least))
    return float(next(m * decade for m in (*digits, 10.0) if m * decade >= least))


def metres_text(metres: float) -> str:
    """Return a length with its unit and at least two significant digits."""
    rounded = abs(metres)
    decimals = 0 if rounded >= 9.95 or rounded < 5e-3 else 1 if rounded >= 0.995 else 2
    return f"{metres:.{decimals}f} m"
