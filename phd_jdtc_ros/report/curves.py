"""Curves of a run's scores over time, filtered behind smoothed, with one row per class."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SOURCES
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.run_scores import Evaluation, ScanScore

from .record import Record, class_of
from .style import GREY, INK, Clock, class_colour, metres_text, row_header, rows_over_time


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
