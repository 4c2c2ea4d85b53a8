"""Draws curves from the pages' own tables, with each label at the end of its line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from page_tables import specified

from phd_jdtc_ros.report.style import COLOURS, DPI, INK, plain_axes

SIZE_IN = (8.0, 4.4)
NUMBER = re.compile(r"[\d.]+")
# Colours as far apart as the palette has them, the reference last.
LINES = (COLOURS[1], COLOURS[2], COLOURS[0], INK)
# The rows of the tables that are drawn, and what they are called at the lines' ends.
CORRECTIONS = {
    "as printed": "paper, as printed",
    "PHD, corrected death term": "PHD filter, corrected",
    "gaussian, motion of the paper": "this tracker",
    "reference": "association known",
}
STEPS = {
    "gaussian": "accuracy: normal",
    "gaussian, accuracy fast": "accuracy: fast",
}
# Between the labels of lines that end near each other, points.
APART = 13.0
STEP_TABLE = "the whole step against targets, CPU medians"


def write_all(docs: Path, images: Path) -> None:
    """Draw the curves of the study and of performance into a folder of images."""
    study = (docs / "study.md").read_text(encoding="utf-8")
    (rows,) = [
        cells
        for shown, cells in specified(study)
        if "ospa" in shown and {*CORRECTIONS} <= {*shown["variants"]}
    ]
    _write(over_lag(rows), images / "ospa_against_lag.png")
    performance = (docs / "performance.md").read_text(encoding="utf-8")
    (rows,) = [c for shown, c in specified(performance) if shown.get("bench") == STEP_TABLE]
    _write(over_targets(rows), images / "step_against_targets.png")


def over_lag(rows: Sequence[Sequence[str]]) -> Figure:
    """Draw the mean OSPA against the lag."""
    figure, axes = _axes()
    axes.set(xlabel="lag (scans)", ylabel="mean OSPA (m)")
    _lines(axes, rows, CORRECTIONS)
    return figure


def over_targets(rows: Sequence[Sequence[str]]) -> Figure:
    """Draw the time of a step against the number of targets, on logarithmic axes."""
    figure, axes = _axes()
    axes.set(xscale="log", yscale="log")
    _lines(axes, [row[:-1] for row in rows], STEPS)
    axes.set(xlabel="targets", ylabel="CPU time of a step (ms)")
    axes.xaxis.set_major_locator(FixedLocator([*map(float, rows[0][1:-1])]))
    axes.xaxis.set_minor_locator(NullLocator())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    return figure


def _axes() -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    return figure, axes


def _lines(axes: Axes, rows: Sequence[Sequence[str]], labels: Mapping[str, str]) -> None:
    """Draw the rows that have a label, over the numbers of the first row."""
    sizes = [float(heading.removeprefix("lag ")) for heading in rows[0][1:]]
    drawn = {row[0]: [NUMBER.match(cell) for cell in row[1:]] for row in rows[1:]}
    ends = []
    for (name, label), colour in zip(labels.items(), LINES, strict=False):
        points = [
            (size, float(cell[0])) for size, cell in zip(sizes, drawn[name], strict=True) if cell
        ]
        x, y = zip(*points, strict=True)
        axes.plot(x, y, color=colour, linewidth=2.2, marker="o", markersize=4.5, clip_on=False)
        ends.append((points[-1], label, colour))
    if axes.get_yscale() == "linear":
        axes.set_ylim(0.0)
    _label_ends(axes, ends, sizes[-1])


def _label_ends(
    axes: Axes, ends: Sequence[tuple[tuple[float, float], str, str]], last: float
) -> None:
    """Write labels beside the ends of lines, apart from each other; above those that end early."""
    highest = float("-inf")
    points_per_dot = 72.0 / DPI
    axes.margins(x=0.03)
    axes.figure.draw_without_rendering()
    for end, label, colour in sorted(ends, key=lambda each: each[0][1]):
        text = {"color": colour, "fontsize": 11, "textcoords": "offset points"}
        if end[0] < last:
            axes.annotate(label, end, xytext=(0, 9), ha="center", va="bottom", **text)
            continue
        height = axes.transData.transform(end)[1] * points_per_dot
        place = max(height, highest + APART)
        axes.annotate(label, end, xytext=(9, place - height), va="center", **text)
        highest = place


def _write(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure).print_png(path)
