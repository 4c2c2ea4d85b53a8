# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The time axis that the interactive charts over time share, and their rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from .chart import lay_out
from .clock import Clock
from .record import Record

# Pixels: of a row, and of what is above and below the rows.
ROW, REST = 150, 90


def rows_over_time(record: Record, names: Sequence[str], label: str) -> Figure:
    """Return rows of axes over time that share it, each with its name above it."""
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
    """Return times on the axis, for a file."""
    rounded: list[float] = np.round(clock.seconds(stamp_ns) / clock.unit_s, 4).tolist()
    return rounded
