# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The interactive map: one scan at a time, in metres or kilometres of equal scale.

A scan shows the detections of every radar, the filtered and the smoothed estimates with their
ellipses, and the truth. Beneath are the true trajectories and the smoothed estimates so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from plotly.basedatatypes import BaseTraceType
from plotly.graph_objects import Figure, Scatter

from msg_adapters.ellipse import RADIUS_95, outline
from msg_adapters.geodetic import heights
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.site import Plane
from phd_jdtc_ros.core.types import SMOOTHED, UNKNOWN, Estimates, Truth

from ..lengths import MapScale, places_of
from ..record import Record
from ..style import DETECTION, class_colour
from ..tracks import true_tracks
from .amplitude_scale import colour_axis, is_known, log_amplitude
from .chart import INK, NEUTRAL, SOURCE_ORDER, Chart, class_dash, class_symbol, lay_out
from .clutter_layer import clutter_layer
from .earth_layer import earth_layer, place_texts, ring_layer
from .scan_list import Scan, scans_of

HEIGHT = 760
_NOWHERE = np.zeros((0, 2))
# The least extent that is shown, in the map's unit.
LEAST_EXTENT = 0.1
RADAR_SYMBOLS = ("circle", "x-thin-open", "cross-thin-open", "square-open", "diamond-open")

CAPTION = (
    "Move the slider, press play, or click on a time in one of the charts below. Drag to pan, "
    "scroll to zoom, double-click to see all again, point at anything to read it; click on an "
    "entry of the legend to hide it. Small marks are detections{coloured}. Open "
    "symbols are filtered estimates and filled ones smoothed estimates, with ellipses of 95 % "
    "probability. Plus signs and lines are the truth. The trail of dots is the smoothed estimates "
    "up to this scan{classes}{clutter}{earth}."
)
EARTH = "; thin lines are latitudes and longitudes, and dotted circles ranges of the radars"
CLUTTER = "; brown squares are where false detections come from, as learned in the end"
WRONG_CLASS = "; a dot in the colour of another class is a wrong class"


class Layer(NamedTuple):
    """A trace and, if it changes, its properties by scan."""

    trace: BaseTraceType
    moving: dict[str, list[Any]]


def scan_map(record: Record) -> Chart:
    """Return the map of a record."""
    scans = scans_of(record)
    amplitudes = np.concatenate([np.zeros(0), *(plot.amplitude for plot in record.plots)])
    amplitudes = amplitudes[is_known(amplitudes)]
    scale = MapScale.of(record)
    x, y = _view(record, scale)
    layers = [
        *_earth(record, x, y, scale),
        *_clutter(record, scale),
        *_true_lines(record, scale),
        *_detections(record, scans, scale),
        *_radars(record, scale),
        *_moving_radars(record, scans, scale),
        *(layer for source in SOURCE_ORDER for layer in _estimates(record, scans, source, scale)),
        *_true_positions(record, scans, scale),
    ]
    figure = Figure([layer.trace for layer in layers])
    lay_out(
        figure,
        HEIGHT,
        **({"coloraxis": colour_axis(amplitudes)} if len(amplitudes) else {}),
        dragmode="pan",
        hovermode="closest",
        xaxis={"title": {"text": f"x ({scale.unit})"}, "range": x, "constrain": "range"},
        yaxis={
            "title": {"text": f"y ({scale.unit})"},
            "range": y,
            "scaleanchor": "x",
            "constrain": "range",
        },
    )
    if record.plane is not None:
        # The graticule takes the place of the grid.
        figure.update_xaxes(showgrid=False)
        figure.update_yaxes(showgrid=False)
    moving = [
        {"trace": index, **layer.moving} for index, layer in enumerate(layers) if layer.moving
    ]
    caption = CAPTION.format(
        coloured=", coloured by amplitude" if len(amplitudes) else "",
        classes="" if record.sets.one_class else WRONG_CLASS,
        clutter="" if record.clutter is None else CLUTTER,
        earth="" if record.plane is None else EARTH,
    )
    return Chart("map", "Scan by scan", caption, figure, moving)


# --- layers ---------------------------------------------------------------------------------------


def _earth(
    record: Record, x: Sequence[float], y: Sequence[float], scale: MapScale
) -> Iterable[Layer]:
    if record.plane is not None:
        for trace in (
            *earth_layer(record.plane, x, y, scale),
            *ring_layer(record.radars, x, y, scale),
        ):
            yield Layer(trace, {})


def _clutter(record: Record, scale: MapScale) -> Iterable[Layer]:
    if record.clutter is not None:
        yield Layer(clutter_layer(record.clutter, scale), {})


def _true_lines(record: Record, scale: MapScale) -> Iterable[Layer]:
    named: set[int] = set()
    for track in sorted(true_tracks(record), key=lambda track: track.class_id):
        yield Layer(
            Scatter(
                x=_on_axis(track.position[:, 0], scale),
                y=_on_axis(track.position[:, 1], scale),
                mode="lines",
                name=f"truth, {record.sets.class_title(track.class_id)}",
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


def _detections(record: Record, scans: Sequence[Scan], scale: MapScale) -> Iterable[Layer]:
    for index, radar in enumerate(sorted({plot.radar for plot in record.plots})):
        seen = [scan.plots.get(radar) for scan in scans]
        symbol = RADAR_SYMBOLS[index % len(RADAR_SYMBOLS)]
        thin = symbol.endswith("open")
        marker = {"symbol": symbol, "size": 7 if thin else 6, "line": {"width": 1.5 * thin}}
        shared = {"mode": "markers", "name": f"detections, {radar}", "legendgroup": radar}
        places = {
            axis: [[] if p is None else _on_axis(p.position[:, k], scale) for p in seen]
            for k, axis in enumerate("xy")
        }
        places |= _texts(
            record, [(_NOWHERE, None) if p is None else (p.position, p.height) for p in seen]
        )
        hover = f"{radar}<br>{_place_text(record, scale)}"
        if not any(is_known(plot.amplitude).any() for plot in seen if plot is not None):
            marker["color"] = DETECTION
            yield Layer(
                Scatter(marker=marker, hovertemplate=f"{hover}<extra></extra>", **shared), places
            )
            continue
        # For the legend only, where a trace with a colour scale would have no colour.
        yield Layer(Scatter(x=[None], y=[None], marker={**marker, "color": NEUTRAL}, **shared), {})
        yield Layer(
            Scatter(
                marker={**marker, "coloraxis": "coloraxis"},
                showlegend=False,
                **shared,
                hovertemplate=f"{hover}<br>amplitude %{{customdata}}<extra></extra>",
            ),
            {
                **places,
                "customdata": [[] if p is None else _significant(p.amplitude) for p in seen],
                "marker.color": [[] if p is None else log_amplitude(p.amplitude) for p in seen],
            },
        )


def _radars(record: Record, scale: MapScale) -> Iterable[Layer]:
    if record.radars:
        position = np.array([radar.position for radar in record.radars])
        east, north = position.T
        sites = _texts(record, [(position, np.array([r.height for r in record.radars]))])
        yield Layer(
            Scatter(
                x=_on_axis(east, scale),
                y=_on_axis(north, scale),
                customdata=[radar.name for radar in record.radars],
                mode="markers",
                name="radars",
                meta=INK,
                marker={"symbol": "star-triangle-up", "size": 10, "color": NEUTRAL},
                hovertemplate=f"%{{customdata}}<br>{_place_text(record, scale)}<extra></extra>",
                **{key: texts for key, (texts,) in sites.items()},
            ),
            {},
        )


def _moving_radars(record: Record, scans: Sequence[Scan], scale: MapScale) -> Iterable[Layer]:
    """Yield the path of every radar that moves, and where it is in each scan."""
    for name in sorted({plot.radar for plot in record.plots if plot.sensor is not None}):
        path = np.array([p.sensor for p in record.plots if p.radar == name and p.sensor])
        seen = [scan.plots.get(name) for scan in scans]
        places = [() if p is None or p.sensor is None else (p.sensor,) for p in seen]
        shared = {"name": f"{name}, moving", "legendgroup": f"{name}, moving", "meta": INK}
        yield Layer(
            Scatter(
                x=_on_axis(path[:, 0], scale),
                y=_on_axis(path[:, 1], scale),
                mode="lines",
                line={"color": NEUTRAL, "width": 1.0, "dash": "dot"},
                hoverinfo="skip",
                showlegend=False,
                **shared,
            ),
            {},
        )
        yield Layer(
            Scatter(
                mode="markers",
                marker={"symbol": "star-triangle-up", "size": 10, "color": NEUTRAL},
                hovertemplate=f"{name}<br>{_place_text(record, scale)}<extra></extra>",
                **shared,
            ),
            {
                axis: [_on_axis(np.array([at[k] for at in place]), scale) for place in places]
                for k, axis in enumerate("xy")
            }
            | _texts(record, [(np.reshape(place, (-1, 2)), None) for place in places]),
        )


def _estimates(
    record: Record, scans: Sequence[Scan], source: str, scale: MapScale
) -> Iterable[Layer]:
    if not record.of_source(source):
        return
    for class_id in range(record.classes):
        rows = [_of_class(scan.estimates.get(source), class_id) for scan in scans]
        label = f"{source}, {record.sets.class_title(class_id)}"
        shared = {"name": label, "legendgroup": label}
        colour = class_colour(class_id)
        if source == SMOOTHED:
            yield _trail(rows, shared, colour, class_id, scale)
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
            {axis: [_outlines(row, scale)[k] for row in rows] for k, axis in enumerate("xy")},
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
                hovertemplate=f"{label} (%{{customdata[0]}} %)<br>{_place_text(record, scale)}<br>"
                "%{customdata[1]} m/s, course %{customdata[2]}&deg;<br>"
                "weight %{customdata[3]}%{customdata[4]}<extra></extra>",
                **shared,
            ),
            {
                **_positions(rows, scale),
                **_texts(record, [(_place(r), None if r is None else heights(r)) for r in rows]),
                "customdata": [_details(row, class_id, record.plane) for row in rows],
            },
        )


def _trail(
    rows: Sequence[Estimates | None],
    shared: dict[str, str],
    colour: str,
    class_id: int,
    scale: MapScale,
) -> Layer:
    """Return the estimates of all scans; the page cuts `x` and `y` after the scan shown."""
    places = [_place(row) for row in rows]
    return Layer(
        Scatter(
            mode="markers",
            marker={"symbol": class_symbol(class_id), "size": 4, "color": colour, "opacity": 0.6},
            hoverinfo="skip",
            showlegend=False,
            x=_on_axis(np.concatenate([place[:, 0] for place in places]), scale),
            y=_on_axis(np.concatenate([place[:, 1] for place in places]), scale),
            **shared,
        ),
        {"upto": np.cumsum([len(place) for place in places]).tolist()},
    )


def _true_positions(record: Record, scans: Sequence[Scan], scale: MapScale) -> Iterable[Layer]:
    class_ids = sorted({k for truth in record.truth for k in truth.class_id.tolist()})
    for class_id in class_ids:
        rows = [_true_places(scan.truth, class_id) for scan in scans]
        title = record.sets.class_title(class_id)
        yield Layer(
            Scatter(
                mode="markers",
                name=f"truth, {title}",
                legendgroup=f"truth {class_id}",
                showlegend=False,
                marker={
                    "symbol": "cross-thin-open",
                    "size": 14,
                    "color": class_colour(class_id),
                    "line": {"width": 1.8, "color": class_colour(class_id)},
                },
                hovertemplate=f"target %{{customdata}}, {title}<br>"
                f"{_place_text(record, scale)}<extra></extra>",
            ),
            {
                "x": [_on_axis(row.position[:, 0], scale) for row in rows],
                "y": [_on_axis(row.position[:, 1], scale) for row in rows],
                "customdata": [row.number.tolist() for row in rows],
                **_texts(record, [(row.position, row.height) for row in rows]),
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
        track_state=estimates.track_state[rows],
        attributes=None if estimates.attributes is None else estimates.attributes.take(rows),
    )


class _TruePlaces(NamedTuple):
    """Targets of a class: positions (T, 2) and heights (T,) in metres, None if not known."""

    position: FloatArray
    height: FloatArray | None
    number: IntArray


def _true_places(truth: Truth | None, class_id: int) -> _TruePlaces:
    if truth is None:
        return _TruePlaces(_NOWHERE, None, np.zeros(0, dtype=np.int64))
    rows = truth.class_id == class_id
    height = None if truth.height is None else truth.height[rows, 0]
    return _TruePlaces(truth.position[rows], height, truth.track_id[rows])


def _place(row: Estimates | None) -> FloatArray:
    return _NOWHERE if row is None else row.position


def _texts(
    record: Record, places: Sequence[tuple[FloatArray, FloatArray | None]]
) -> dict[str, list[Any]]:
    """Return the places' latitudes, longitudes and heights by scan; nothing without a plane.

    Parameters
    ----------
    record : Record
    places : sequence of (positions of shape (N, 2), heights of shape (N,) or None), metres
    """
    if record.plane is None:
        return {}
    return {
        "text": [
            place_texts(
                record.plane, place, np.full(len(place), np.nan) if height is None else height
            )
            for place, height in places
        ]
    }


def _positions(rows: Sequence[Estimates | None], scale: MapScale) -> dict[str, list[Any]]:
    places = [_place(row) for row in rows]
    return {axis: [_on_axis(place[:, k], scale) for place in places] for k, axis in enumerate("xy")}


def _outlines(row: Estimates | None, scale: MapScale) -> tuple[list[Any], list[Any]]:
    """Return the 95 % ellipses as one line, with None between them."""
    x: list[Any] = []
    y: list[Any] = []
    if row is not None:
        for centre, covariance in zip(_place(row), row.position_covariance, strict=True):
            around = outline(covariance, RADIUS_95, 25)
            x += [*_on_axis(centre[0] + around[0], scale), None]
            y += [*_on_axis(centre[1] + around[1], scale), None]
    return x, y


def _details(row: Estimates | None, class_id: int, plane: Plane | None) -> list[list[Any]]:
    """Return per estimate: class probability (%), speed (m/s), course, weight, and who it is.

    The course is in degrees clockwise from y, or with a plane from true north.
    """
    if row is None:
        return []
    vx, vy = row.velocity.T
    course = np.degrees(np.arctan2(vx, vy))
    if plane is not None:
        course = course + np.degrees(plane.convergence(*plane.to_geodetic(*row.position.T)))
    columns = (
        np.round(100.0 * row.class_probability[:, class_id], 1),
        np.round(np.hypot(vx, vy), 1),
        np.round(course % 360.0),
        np.round(row.weight, 2),
    )
    rows = zip(*(column.tolist() for column in columns), _identities(row), strict=True)
    return [list(entry) for entry in rows]


def _identities(row: Estimates) -> list[str]:
    """Return the track numbers, codes and addresses of estimates, as far as they are known."""
    texts = [f", track {number}" if number else "" for number in row.track_id.tolist()]
    known = row.attributes
    if known is None:
        return texts
    return [
        text
        + (f", code {code:04o}" if code != UNKNOWN else "")
        + (f", address {address:06X}" if address != UNKNOWN else "")
        for text, code, address in zip(
            texts, known.code.tolist(), known.address.tolist(), strict=True
        )
    ]


def _on_axis(metres: FloatArray, scale: MapScale) -> list[float]:
    rounded: list[float] = np.round(scale.of_metres(metres), scale.decimals).tolist()
    return rounded


def _place_text(record: Record, scale: MapScale) -> str:
    """Return plotly's template of a point's place: to a metre, or to a decimetre on short maps.

    With a plane its latitude, longitude and height follow, which are the point's text.
    """
    digits = scale.decimals - 1
    text = f"%{{x:.{digits}f}}, %{{y:.{digits}f}} {scale.unit}"
    return text if record.plane is None else f"{text}<br>%{{text}}"


def _significant(values: FloatArray) -> list[float | str]:
    return [float(f"{value:.3g}") if np.isfinite(value) else "not known" for value in values]


def _view(record: Record, scale: MapScale) -> tuple[list[float], list[float]]:
    """Return the ranges on the axes that contain the targets, or if none the detections."""
    places = scale.of_metres(places_of(record))
    if not len(places):
        return [-1.0, 1.0], [-1.0, 1.0]
    low, high = places.min(axis=0), places.max(axis=0)
    margin = 0.06 * max(float(np.max(high - low)), LEAST_EXTENT)
    lowest, highest = (np.round(end, scale.decimals) for end in (low - margin, high + margin))
    return [float(lowest[0]), float(highest[0])], [float(lowest[1]), float(highest[1])]
