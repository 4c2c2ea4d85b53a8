"""The pictures of a run and of a registration: pure functions from records to figures.

Maps have equal scales (`maps`); times count from the run's first stamp. A class has
the same colour, line and marker in every picture (`style`). Figures do not use matplotlib's global
state, so that they can be drawn from any thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from phd_jdtc_ros.calibration.registration.solution import RadarEstimate, Registration
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SOURCES
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.run_scores import ScanScore

from . import maps, style
from .record import Record, class_of
from .style import (
    DPI,
    GREY,
    INK,
    WIDTH_IN,
    Clock,
    class_colour,
    metres_text,
    plain_axes,
    row_header,
    rows_over_time,
)


class Panel(NamedTuple):
    """One row of a figure over time."""

    title: str
    colour: str
    # Times in the clock's unit and values, by source; no entry without scores.
    series: dict[str, tuple[FloatArray, FloatArray]]

    @staticmethod
    def of(
        record: Record, evaluation: Evaluation, key: str, value: Callable[[dict[str, Any]], float]
    ) -> Panel:
        """Return the panel of the set `key`; `value` extracts the number from a score."""
        clock = Clock.of(record)
        series = {}
        for source in SOURCES:
            scans: list[ScanScore] = [scan for _, scan in sorted(evaluation.scores[source].items())]
            if scans:
                time = clock.seconds([scan.stamp_ns for scan in scans]) / clock.unit_s
                series[source] = time, np.array([float(value(s.values[key])) for s in scans])
        colour = INK if key == ALL else class_colour(class_of(key))
        return Panel(record.sets.title(key), colour, series)


def number_error(record: Record, evaluation: Evaluation) -> Figure:
    """Draw n_est - n_true over time, one row per class."""
    keys = record.sets.of_classes or [ALL]
    panels = [
        Panel.of(record, evaluation, key, lambda values: values["n_est"] - values["n_true"])
        for key in keys
    ]
    figure, rows = _rows(record, len(panels), "estimated - true")
    for axes, panel in zip(rows, panels, strict=True):
        for source, (time, value) in panel.series.items():
            label = f"{source}, mean |error| {np.abs(value).mean():.3f}"
            if source == FILTERED:
                axes.fill_between(
                    time, value, step="mid", color=GREY, alpha=0.55, linewidth=0, label=label
                )
            else:
                axes.step(time, value, where="mid", color=panel.colour, linewidth=1.4, label=label)
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -1.2), max(high, 1.2))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
        row_header(axes, panel.title)
    return figure


def ospa(record: Record, evaluation: Evaluation) -> Figure:
    """Draw the OSPA distance over time, one row per class and one for all targets.

    A single class has no row of its own.
    """
    panels = [
        Panel.of(record, evaluation, key, lambda values: values["ospa"])
        for key in (*record.sets.of_classes, ALL)
    ]
    return _distances(record, panels, "OSPA (m)")


def ospa_parts(record: Record, evaluation: Evaluation) -> Figure:
    """Draw the localisation part and the cardinality part of all targets' OSPA over time."""
    location = Panel.of(record, evaluation, "all", lambda values: values["localization"])
    number = Panel.of(record, evaluation, "all", lambda values: values["cardinality"])
    panels = [
        location._replace(title=f"{location.title}: localisation part"),
        number._replace(title=f"{number.title}: cardinality part"),
    ]
    return _distances(record, panels, "part of OSPA (m)")


def _distances(record: Record, panels: Sequence[Panel], label: str) -> Figure:
    """Draw one row per panel, filtered behind smoothed, each with its mean."""
    figure, rows = _rows(record, len(panels), label)
    for axes, panel in zip(rows, panels, strict=True):
        for source, (time, value) in panel.series.items():
            colour, width = (GREY, 1.1) if source == FILTERED else (panel.colour, 1.6)
            mean = value.mean()
            axes.plot(
                time,
                value,
                "-" if len(time) > 1 else ".",
                color=colour,
                # Number of scans above which lines are drawn thin.
                linewidth=width if len(time) <= 400 else 0.5,
                label=f"{source}, mean {metres_text(mean)}",
            )
            axes.axhline(mean, color=colour, linewidth=1.0, linestyle=(0, (5, 3)), zorder=3)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
        row_header(axes, panel.title)
    highest = max(axes.dataLim.y1 for axes in rows)
    rows[0].set_ylim(0.0, 1.05 * highest if highest > 0.0 else 1.0)
    return figure


def _rows(record: Record, rows: int, label: str) -> tuple[Figure, list[Axes]]:
    clock = Clock.of(record)
    span = max(clock.span_s, 1.0) / clock.unit_s
    return rows_over_time(rows, label, f"time from the first scan ({clock.unit})", span)


def write_all(record: Record, evaluation: Evaluation, directory: Path) -> list[Path]:
    """Write all pictures for which the run has data, as PNG files 1200 pixels wide.

    The directory is created if necessary; the paths are returned in reading order.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for picture in PICTURES:
        if picture.has_data(record, evaluation):
            path = directory / f"{picture.name}.png"
            style.save(picture.draw(record, evaluation), path)
            paths.append(path)
    return paths


class Picture(NamedTuple):
    """One kind of picture."""

    name: str  # Name of the file, without suffix
    has_data: Callable[[Record, Evaluation], bool]
    draw: Callable[[Record, Evaluation], Figure]


def _has_truth(record: Record, _: Evaluation) -> bool:
    return any(len(truth.state) for truth in record.truth)


def _has_detections(record: Record, _: Evaluation) -> bool:
    return any(len(plot.position) for plot in record.plots)


def _has_positions(record: Record, evaluation: Evaluation) -> bool:
    return _has_truth(record, evaluation) or any(len(run) for run in record.smoothed)


def _has_clutter(record: Record, _: Evaluation) -> bool:
    return record.clutter is not None and bool((record.clutter.density > 0.0).any())


def _has_scores(_: Record, evaluation: Evaluation) -> bool:
    return any(evaluation.scores[source] for source in SOURCES)


PICTURES = (
    Picture("scenario", _has_truth, lambda record, _: maps.scenario(record)),
    Picture("measurements", _has_detections, lambda record, _: maps.measurements(record)),
    Picture("clutter", _has_clutter, lambda record, _: maps.clutter(record)),
    Picture("trajectories", _has_positions, lambda record, _: maps.trajectories(record)),
    Picture("number_error", _has_scores, number_error),
    Picture("ospa", _has_scores, ospa),
    Picture("ospa_parts", _has_scores, ospa_parts),
)


# Rows of axes: name, unit and scale of the residual.
ROWS = (("range", "m", 1.0), ("azimuth, left", "degrees", float(np.degrees(1.0))))
# Number of equal parts of the time, each with its mean drawn.
PARTS = 20


def residuals(found: Registration) -> Figure:
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
            _draw(axes, each, row, scale, begin, unit_s)
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


def _draw(
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
