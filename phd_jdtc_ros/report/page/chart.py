"""Type, axes and colours of the page's interactive charts.

Charts are transparent and take the colours of text, rules and neutral lines from the page, light or
dark. Only classes and amplitudes have fixed colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from ..record import Record
from ..units import Clock

# Value of `meta` for traces whose line or text is drawn in the page's text colour.
INK = "ink"
# A grey with contrast on light and on dark pages.
NEUTRAL = "#858585"
FONT = {"family": "system-ui, Segoe UI, Liberation Sans, sans-serif", "size": 13}


class Chart(NamedTuple):
    """An interactive chart of a page."""

    name: str  # Id of the chart's element
    title: str
    caption: str  # Describes the chart and its main message
    figure: Figure


# Heights in pixels: of a row, and of the space above and below the rows.
ROW, REST = 150, 90


def rows_over_time(record: Record, names: Sequence[str], label: str) -> Figure:
    """Return rows of axes that share the time axis, each with its name above.

    The figure is transparent, with the legend on top and margins for labels.
    """
    clock = Clock.of(record)
    height = REST + ROW * len(names)
    figure = make_subplots(
        rows=len(names),
        cols=1,
        shared_xaxes=True,
        subplot_titles=[f"<b>{name}</b>" for name in names],
        vertical_spacing=min(34.0 / (height - REST), 1.0 / max(len(names) - 1, 1) / 2.0),
    )
    figure.update_layout(
        template="none",
        height=height,
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font=FONT,
        margin={"l": 60, "r": 16, "t": 64, "b": 48},
        legend={
            "orientation": "h",
            "yanchor": "bottom",
            "y": 1.0 + 26.0 / (height - REST),
            "xanchor": "left",
            "x": 0.0,
            "tracegroupgap": 0,
        },
        hoverlabel={"font": FONT},
        hovermode="x",
        dragmode="zoom",
    )
    for update in (figure.update_xaxes, figure.update_yaxes):
        update(gridcolor=NEUTRAL, gridwidth=0.5, zeroline=False, automargin=True)
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 13})
    figure.update_yaxes(title={"text": label, "standoff": 8})
    span = max(clock.span_s, 1.0) / clock.unit_s
    figure.update_xaxes(range=[-0.01 * span, 1.01 * span])
    figure.update_xaxes(
        title={"text": f"time from {clock.begin or 'the first scan'} ({clock.unit})"},
        row=len(names),
        col=1,
    )
    return figure


def times(clock: Clock, stamp_ns: Sequence[int]) -> list[float]:
    """Return times on the axis, rounded to keep the file small."""
    rounded: list[float] = np.round(clock.seconds(stamp_ns) / clock.unit_s, 4).tolist()
    return rounded
