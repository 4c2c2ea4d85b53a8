# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The interactive map: one scan at a time, in kilometres with equal scales.

A scan shows the detections of every radar, the filtered and the smoothed estimates with their
ellipses, and the truth. Beneath are the true trajectories and the smoothed estimates so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from plotly.graph_objects import Figure, Scatter

from msg_adapters.ellipse import RADIUS_95, outline
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import SMOOTHED, Estimates, Truth

from ..record import Record
from ..style import class_colour, class_name
from ..tracks import true_tracks
from .amplitude_scale import colour_axis, log_amplitude
from .chart import INK, NEUTRAL, SOURCE_ORDER, Chart, class_dash, class_symbol, lay_out
from .scan_list import Scan, scans_of

HEIGHT = 760
# A tenth of a metre, which is finer than a reader can see.
DECIMALS = 4
RADAR_SYMBOLS = ("circle", "x-thin-open", "cross-thin-open", "square-open", "diamond-open")

CAPTION = (
    "Move the slider, press play, or click on a time in one of the charts below. Drag to pan, "
    "scroll to zoom, double-click to see all again, point at anything to read it; click on an "
    "entry of the legend to hide it. Small marks are detections, coloured by amplitude. Open "
    "symbols are filtered estimates and filled ones smoothed estimates, with ellipses of 95 % "
    "probability. Plus signs and lines are the truth. The trail of dots is the smoothed estimates "
    "up to this scan; a dot in the colour of another class is a wrong class."
)


class Layer(NamedTuple):
    """A trace and, if it changes, its properties by scan."""

    trace: Scatter
    moving: dict[str, list[Any]]


def scan_map(record: Record) -> Chart:
    """Return the map of a record."""
    scans = scans_of(record)
    amplitudes = np.concatenate([np.zeros(0), *(plot.amplitude for plot in record.plots)])
    layers = [
        *_true_lines(record),
        *_detections(record, scans),
        *_radars(record),
        *(layer for source in SOURCE_ORDER for layer in _estimates(record, scans, source)),
        *_true_positions(record, scans),
    ]
    figure = Figure([layer.trace for layer in layers])
    x, y = _view(record)
    lay_out(
        figure,
        HEIGHT,
        coloraxis=colour_axis(amplitudes),
        dragmode="pan",
        hovermode="closest",
        xaxis={"title": {"text": "x (km)"}, "range": x, "constrain": "range"},
        yaxis={
            "title": {"text": "y (km)"},
            "range": y,
            "scaleanchor": "x",
            "constrain": "range",
        },
    )
    moving = [
        {"trace": index, **layer.moving} for index, layer in enumerate(layers) if layer.moving
    ]
    return Chart("map", "Scan by scan", CAPTION, figure, moving)


# --- layers ---------------------------------------------------------------------------------------


def _true_lines(record: Record) -> Iterable[Layer]:
    named: set[int] = set()
    for track in sorted(true_tracks(record), key=lambda track: track.class_id):
        yield Layer(
            Scatter(
                x=_plain(track.position[:, 0]),
                y=_plain(track.position[:, 1]),
                mode="lines",
                name=f"truth, {class_name(track.class_id)}",
                legendgroup=f"truth {track.class_id}",
                showlegend=track.class_id not in named,
                line={
                    "color": class_colour(track.class_id),
                    "width": 1.2,
                    "dash": class_dash(track.class_id),
                },
                opacity=0.55,
                hoverinfo="skip",
            ),
            {},
        )
        named.add(track.class_id)


def _detections(record: Record, scans: Sequence[Scan]) -> Iterable[Layer]:
    for index, radar in enumerate(sorted({plot.radar for plot in record.plots})):
        seen = [scan.plots.get(radar) for scan in scans]
        symbol = RADAR_SYMBOLS[index % len(RADAR_SYMBOLS)]
        thin = symbol.endswith("open")
        marker = {"symbol": symbol, "size": 7 if thin else 6, "line": {"width": 1.5 * thin}}
        shared = {"mode": "markers", "name": f"detections, {radar}", "legendgroup": radar}
        # For the legend only, where a trace with a colour scale would have no colour.
        yield Layer(Scatter(x=[None], y=[None], marker={**marker, "color": NEUTRAL}, **shared), {})
        yield Layer(
            Scatter(
                marker={**marker, "coloraxis": "coloraxis"},
                showlegend=False,
                **shared,
                hovertemplate=f"{radar}<br>%{{x:.3f}}, %{{y:.3f}} km<br>"
                "amplitude %{customdata}<extra></extra>",
            ),
            {
                "x": [[] if plot is None else _km(plot.position[:, 0]) for plot in seen],
                "y": [[] if plot is None else _km(plot.position[:, 1]) for plot in seen],
                "customdata": [[] if p is None else _significant(p.amplitude) for p in seen],
                "marker.color": [[] if p is None else log_amplitude(p.amplitude) for p in seen],
            },
        )


def _radars(record: Record) -> Iterable[Layer]:
    if record.radars:
        east, north = zip(*(radar.position for radar in record.radars), strict=True)
        yield Layer(
            Scatter(
                x=_km(np.array(east)),
                y=_km(np.array(north)),
                text=[radar.name for radar in record.radars],
                mode="markers",
                name="radars",
                meta=INK,
                marker={"symbol": "star-triangle-up", "size": 10, "color": NEUTRAL},
                hovertemplate="%{text}<br>%{x:.3f}, %{y:.3f} km<extra></extra>",
            ),
            {},
        )


def _estimates(record: Record, scans: Sequence[Scan], source: str) -> Iterable[Layer]:
    if not record.of_source(source):
        return
    for class_id in range(record.classes):
        rows = [_of_class(scan.estimates.get(source), class_id) for scan in scans]
        label = f"{source}, {class_name(class_id)}"
        shared = {"name": label, "legendgroup": label}
        colour = class_colour(class_id)
        if source == SMOOTHED:
            yield _trail(rows, shared, colour, class_id)
        yield Layer(
            Scatter(
                mode="lines",
                line={
                    "color": colour,
                    "width": 1.3,
                    "dash": "solid" if source == SMOOTHED else "dot",
                },
                hoverinfo="skip",
                showlegend=False,
                **shared,
            ),
            {axis: [_outlines(row)[k] for row in rows] for k, axis in enumerate("xy")},
        )
        yield Layer(
            Scatter(
                mode="markers",
                marker={
                    "symbol": class_symbol(class_id, filled=source == SMOOTHED),
                    "size": 9 if source == SMOOTHED else 13,
                    "color": colour,
                    "line": {"width": 0 if source == SMOOTHED else 1.6, "color": colour},
                },
                hovertemplate=f"{label} (%{{customdata[0]}} %)<br>%{{x:.3f}}, %{{y:.3f}} km<br>"
                "%{customdata[1]} m/s, course %{customdata[2]}&deg;<br>"
                "weight %{customdata[3]}%{customdata[4]}<extra></extra>",
                **shared,
            ),
            {**_positions(rows), "customdata": [_details(row, class_id) for row in rows]},
        )


def _trail(
    rows: Sequence[Estimates | None], shared: dict[str, str], colour: str, class_id: int
) -> Layer:
    """Return the estimates of all scans; the page cuts `x` and `y` after the scan shown."""
    places = [_place(row) for row in rows]
    return Layer(
        Scatter(
            mode="markers",
            marker={"symbol": class_symbol(class_id), "size": 4, "color": colour, "opacity": 0.6},
            hoverinfo="skip",
            showlegend=False,
            x=_km(np.concatenate([place[:, 0] for place in places])),
            y=_km(np.concatenate([place[:, 1] for place in places])),
            **shared,
        ),
        {"upto": np.cumsum([len(place) for place in places]).tolist()},
    )


def _true_positions(record: Record, scans: Sequence[Scan]) -> Iterable[Layer]:
    class_ids = sorted({k for truth in record.truth for k in truth.class_id.tolist()})
    for class_id in class_ids:
        rows = [_true_places(scan.truth, class_id) for scan in scans]
        yield Layer(
            Scatter(
                mode="markers",
                name=f"truth, {class_name(class_id)}",
                legendgroup=f"truth {class_id}",
                showlegend=False,
                marker={
                    "symbol": "cross-thin-open",
                    "size": 14,
                    "color": class_colour(class_id),
                    "line": {"width": 1.8, "color": class_colour(class_id)},
                },
                hovertemplate=f"target %{{customdata}}, {class_name(class_id)}<br>"
                "%{x:.3f}, %{y:.3f} km<extra></extra>",
            ),
            {
                "x": [_km(place[:, 0]) for place, _ in rows],
                "y": [_km(place[:, 1]) for place, _ in rows],
                "customdata": [number.tolist() for _, number in rows],
            },
        )


# --- numbers --------------------------------------------------------------------------------------


def _of_class(estimates: Estimates | None, class_id: int) -> Estimates | None:
    if estimates is None:
        return None
    rows = estimates.class_id == class_id
    return replace(
        estimates,
        state=estimates.state[rows],
        covariance=estimates.covariance[rows],
        weight=estimates.weight[rows],
        class_probability=estimates.class_probability[rows],
        class_id=estimates.class_id[rows],
        track_id=estimates.track_id[rows],
    )


def _true_places(truth: Truth | None, class_id: int) -> tuple[FloatArray, IntArray]:
    """Return positions in metres, shape (T, 2), and numbers of the targets of a class."""
    if truth is None:
        return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    rows = truth.class_id == class_id
    return truth.position[rows], truth.track_id[rows]


def _place(row: Estimates | None) -> FloatArray:
    return np.zeros((0, 2)) if row is None else row.position


def _positions(rows: Sequence[Estimates | None]) -> dict[str, list[Any]]:
    places = [_place(row) for row in rows]
    return {axis: [_km(place[:, k]) for place in places] for k, axis in enumerate("xy")}


def _outlines(row: Estimates | None) -> tuple[list[Any], list[Any]]:
    """Return the 95 % ellipses as one line, with None between them."""
    x: list[Any] = []
    y: list[Any] = []
    if row is not None:
        for centre, covariance in zip(_place(row), row.position_covariance, strict=True):
            around = outline(covariance, RADIUS_95, 25)
            x += [*_km(centre[0] + around[0]), None]
            y += [*_km(centre[1] + around[1]), None]
    return x, y


def _details(row: Estimates | None, class_id: int) -> list[list[Any]]:
    """Return per estimate: class probability (%), speed (m/s), course, weight and track number.

    The course is in degrees clockwise from y.
    """
    if row is None:
        return []
    vx, vy = row.velocity.T
    columns = (
        np.round(100.0 * row.class_probability[:, class_id], 1),
        np.round(np.hypot(vx, vy), 1),
        np.round(np.degrees(np.arctan2(vx, vy)) % 360.0),
        np.round(row.weight, 2),
    )
    numbers = [f", track {number}" if number else "" for number in row.track_id.tolist()]
    rows = zip(*(column.tolist() for column in columns), numbers, strict=True)
    return [list(entry) for entry in rows]


def _km(metres: FloatArray) -> list[float]:
    return _plain(metres / 1e3)


def _plain(values: FloatArray) -> list[float]:
    rounded: list[float] = np.round(values, DECIMALS).tolist()
    return rounded


def _significant(values: FloatArray) -> list[float]:
    return [float(f"{value:.3g}") for value in values]


def _view(record: Record) -> tuple[list[float], list[float]]:
    """Return the ranges in kilometres that contain the targets, or if none the detections."""
    targets = [truth.position for truth in record.truth]
    targets += [_place(row) for source in SOURCE_ORDER for row in record.of_source(source)]
    places = np.concatenate([np.zeros((0, 2)), *targets])
    if not len(places):
        places = np.concatenate([np.zeros((0, 2)), *(plot.position for plot in record.plots)])
    if not len(places):
        return [-1.0, 1.0], [-1.0, 1.0]
    low, high = places.min(axis=0) / 1e3, places.max(axis=0) / 1e3
    margin = 0.06 * max(float(np.max(high - low)), 0.1)
    lowest, highest = _plain(low - margin), _plain(high + margin)
    return [lowest[0], highest[0]], [lowest[1], highest[1]]
