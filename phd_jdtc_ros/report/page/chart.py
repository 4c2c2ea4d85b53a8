"""Type, axes and colours of the page's interactive charts.

Charts are transparent and take the colours of text, rules and neutral lines from the page, light or
dark. Only classes and amplitudes have fixed colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED

from ..clock import Clock
from ..record import Record

# Value of `meta` for traces whose line or text is drawn in the page's text colour.
INK = "ink"
# A grey with contrast on light and on dark pages.
NEUTRAL = "#858585"
FONT = {"family": "system-ui, Segoe UI, Liberation Sans, sans-serif", "size": 13}

# Plotly's names for the styles that the pictures use.
SYMBOLS = ("circle", "triangle-up", "square", "diamond", "triangle-down", "cross")
DASHES = ("solid", "dash", "dashdot", "dot")

SOURCE_ORDER = (SMOOTHED, FILTERED)


class Chart(NamedTuple):
    """An interactive chart of a page.

    Parameters
    ----------
    name : str
        Id of the chart's element.
    title, caption : str
        The caption describes the chart and its main message.
    figure : plotly.graph_objects.Figure
    """

    name: str
    title: str
    caption: str
    figure: Figure


def class_symbol(class_id: int, filled: bool = True) -> str:
    """Return the marker of a class; filtered estimates have an open one."""
    symbol = SYMBOLS[class_id % len(SYMBOLS)]
    return symbol if filled else f"{symbol}-open"


def class_dash(class_id: int) -> str:
    """Return the line style of a class."""
    return DASHES[class_id % len(DASHES)]


def lay_out(figure: Figure, height: int, **layout: Any) -> None:
    """Apply the layout of all charts: transparency, a legend on top, margins for labels."""
    figure.update_layout(
        template="none",
        height=height,
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font=FONT,
        margin={"l": 60, "r": 16, "t": 40, "b": 48},
        legend={
            "orientation": "h",
            "yanchor": "bottom",
            "y": 1.0,
            "xanchor": "left",
            "x": 0.0,
            "tracegroupgap": 0,
        },
        hoverlabel={"font": FONT},
        **layout,
    )
    figure.update_xaxes(gridcolor=NEUTRAL, gridwidth=0.5, zeroline=False, automargin=True)
    figure.update_yaxes(gridcolor=NEUTRAL, gridwidth=0.5, zeroline=False, automargin=True)


# Heights in pixels: of a row, and of the space above and below the rows.
ROW, REST = 150, 90


def rows_over_time(record: Record, names: Sequence[str], label: str) -> Figure:
    """Return rows of axes that share the time axis, each with its name above."""
    clock = Clock.of(record)
    height = REST + ROW * len(names)
    figure = make_subplots(
        rows=len(names),
        cols=1,
        shared_xaxes=True,
        subplot_titles=[f"<b>{name}</b>" for name in names],
        vertical_spacing=min(34.0 / (height - REST), 1.0 / max(len(names) - 1, 1) / 2.0),
    )
    lay_out(figure, height, hovermode="x", dragmode="zoom")
    figure.update_layout(margin={"t": 64}, legend={"y": 1.0 + 26.0 / (height - REST)})
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 13})
    figure.update_yaxes(title={"text": label, "standoff": 8})
    span = max(clock.span_s, 1.0) / clock.unit_s
    figure.update_xaxes(range=[-0.01 * span, 1.01 * span])
    figure.update_xaxes(
        title={"text": f"time from the first scan ({clock.unit})"}, row=len(names), col=1
    )
    return figure


def times(clock: Clock, stamp_ns: Sequence[int]) -> list[float]:
    """Return times on the axis, rounded to keep the file small."""
    rounded: list[float] = np.round(clock.seconds(stamp_ns) / clock.unit_s, 4).tolist()
    return rounded
