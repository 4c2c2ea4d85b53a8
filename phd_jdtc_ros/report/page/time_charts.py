"""The interactive charts of scores and numbers over time, with filter and smoother."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from plotly.graph_objects import Figure, Scatter

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import SMOOTHED, SOURCES
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.evaluation import Evaluation

from ..record import Record
from ..sets import class_of
from ..style import class_colour
from ..units import Clock, metres_text, round_step
from .chart import INK, NEUTRAL, Chart, rows_over_time, times

BAND = "rgba(133,133,133,0.22)"

OSPA_CAPTION = (
    "OSPA distance (p = {p:g}, c = {c:g} m) of the filtered and of the smoothed estimates to the "
    "truth. Lower is better. Peaks are scans with a wrong number of targets; the level between "
    "them is the position error."
)
NUMBER_CAPTION = (
    "The number of targets{in_all}. {truth}{classes}Spikes of the filter only are errors that the "
    "smoother has repaired."
)
OF_CLASSES = "Opposite spikes in two classes at one time are a target with the wrong class. "
TRUE_NUMBER = "The grey area is the true number. "


def ospa(record: Record, evaluation: Evaluation) -> Chart:
    """Return the OSPA distance over time, one row for all targets and one per class."""
    keys = record.sets.keys
    figure = rows_over_time(record, [record.sets.title(key) for key in keys], "OSPA (m)")
    for row, key in enumerate(keys, 1):
        for source in SOURCES:
            time, value = _distances(record, evaluation, source, key)
            if len(time):
                text = f"{metres_text(value.mean())} {source}"
                _append_title(figure, row, text)
                _line(figure, row, key, source, time, np.round(value, 2), " m")
    figure.update_yaxes(rangemode="tozero")
    caption = OSPA_CAPTION.format(p=evaluation.order, c=evaluation.cutoff)
    return Chart("ospa", "OSPA distance over time", caption, figure)


def numbers(record: Record) -> Chart:
    """Return the number of targets over time, one row for all targets and one per class."""
    keys = record.sets.keys
    figure = rows_over_time(record, [record.sets.title(key) for key in keys], "targets")
    clock = Clock.of(record)
    for row, key in enumerate(keys, 1):
        if record.truth:
            figure.add_trace(
                Scatter(
                    x=times(clock, [truth.stamp_ns for truth in record.truth]),
                    y=[
                        _count(
                            truth.class_id[np.hypot(*truth.velocity.T) >= record.least_speed], key
                        )
                        for truth in record.truth
                    ],
                    name="truth",
                    legendgroup="truth",
                    showlegend=row == 1,
                    mode="lines",
                    fill="tozeroy",
                    fillcolor=BAND,
                    line={"shape": "hvh", "color": NEUTRAL, "width": 0.5},
                    hovertemplate="%{y} true<extra></extra>",
                ),
                row=row,
                col=1,
            )
        for source in SOURCES:
            run = record.of_source(source)
            if run:
                time = times(clock, [found.stamp_ns for found in run])
                value = np.array([_count(found.class_id, key) for found in run])
                _line(figure, row, key, source, time, value, "", shape="hvh")
    step = round_step(max(*(max(trace.y, default=0) / 4.0 for trace in figure.data), 1.0))
    figure.update_yaxes(rangemode="tozero", tick0=0, dtick=int(step))
    several = not record.sets.one_class
    caption = NUMBER_CAPTION.format(
        in_all=", in all and per class" if several else "",
        truth=TRUE_NUMBER if record.truth else "",
        classes=OF_CLASSES if several else "",
    )
    return Chart("numbers", "Number of targets over time", caption, figure)


def _distances(
    record: Record, evaluation: Evaluation, source: str, key: str
) -> tuple[list[float], FloatArray]:
    """Return the times and the OSPA distances of a source's scans."""
    scans = [scan for _, scan in sorted(evaluation.scores[source].items())]
    time = times(Clock.of(record), [scan.stamp_ns for scan in scans])
    return time, np.array([scan.values[key]["ospa"] for scan in scans])


def _count(class_id: Any, key: str) -> int:
    return len(class_id if key == ALL else class_id[class_id == class_of(key)])


def _append_title(figure: Figure, row: int, text: str) -> None:
    title = figure.layout.annotations[row - 1]
    title.text += f" \N{MIDDLE DOT} mean {text}" if "mean" not in title.text else f", {text}"


def _line(
    figure: Figure,
    row: int,
    key: str,
    source: str,
    time: Sequence[float],
    value: Any,
    unit: str,
    shape: str = "linear",
) -> None:
    """Add a source to a row: the filter thin and neutral, the smoother in the row's colour."""
    smoothed = source == SMOOTHED
    colour = NEUTRAL if key == ALL or not smoothed else class_colour(class_of(key))
    figure.add_trace(
        Scatter(
            x=time,
            y=value.tolist(),
            name=source,
            legendgroup=source,
            showlegend=row == 1,
            mode="lines" if len(time) > 1 else "markers",
            meta=INK if smoothed and key == ALL else None,
            line={"color": colour, "width": 2.0 if smoothed else 1.2, "shape": shape},
            hovertemplate=f"%{{y}}{unit} {source}<extra></extra>",
        ),
        row=row,
        col=1,
    )
