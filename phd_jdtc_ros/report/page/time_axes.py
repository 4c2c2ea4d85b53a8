"""The rows and the time axis of the interactive charts over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from ..clock import Clock
from ..record import Record
from .chart import lay_out

# Heights in pixels: of a row, and of the space above and below the rows.
ROW, REST = 150, 90


def rows_over_time(record: Record, names: Sequence[str], label: str) -> Figure:
    """Return rows of axes that share the time axis, each with its name above it."""
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
