# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Latitudes, longitudes and ranges of the radars, beneath the interactive map.

They are computed, not loaded: the page shows no map tiles, and works without a network.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from plotly.graph_objects import Scatter

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.site import Plane

from ..lengths import MapScale
from ..record import RadarSite

LINE = "rgba(128,128,128,0.45)"
# Lines of the graticule across the map, at most, and the steps between them, degrees.
MOST_LINES = 8
STEPS = tuple(m * 10.0**k for k in (1, 0, -1, -2, -3, -4) for m in (5.0, 2.0, 1.0))
# Points of a line or a ring.
POINTS = 73
# Rings of a radar, at most, and the steps between them as multiples of a power of ten.
MOST_RINGS, RING_STEPS = 4, (1.0, 2.0, 2.5, 5.0)
# How far the lines go beyond what the map first shows, in its extents: pages are wide.
BEYOND_X, BEYOND_Y = 0.6, 0.1
LABEL = {"mode": "text", "textfont": {"size": 10}, "hoverinfo": "skip", "showlegend": False}
SHARED = {"mode": "lines", "hoverinfo": "skip"}


def earth_layer(
    plane: Plane, x: Sequence[float], y: Sequence[float], scale: MapScale
) -> Iterator[Scatter]:
    """Yield the graticule: its lines as one trace, and its labels.

    Parameters
    ----------
    plane : Plane
    x, y : sequences of two floats
        What the map first shows, in its unit.
    scale : MapScale
    """
    # One line after the other, with a gap between them.
    lines: list[list[FloatArray]] = []
    labels: list[tuple[float, float, str]] = []
    low, high = _wider(x, y)
    latitudes, longitudes = _extent(plane, low * scale.metres, high * scale.metres)
    edge = np.array([x[0], y[0]])
    for along, across, name in ((0, 1, "NS"), (1, 0, "EW")):
        extents = (latitudes, longitudes)
        step = _step(extents[along])
        for value in _multiples(extents[along], step):
            other = np.linspace(*extents[across], POINTS)
            pair = (
                (np.full(POINTS, value), other) if along == 0 else (other, np.full(POINTS, value))
            )
            place = scale.of_metres(np.stack(plane.to_plane(*pair)))
            lines.append([*place])
            # Parallels are named where they enter the map on the left, meridians at the bottom.
            nearest = int(np.argmin(np.abs(place[along] - edge[along])))
            labels.append((*place[:, nearest].tolist(), degrees(value, step, name)))
    drawn = _joined(lines, scale)
    yield Scatter(
        x=drawn[0],
        y=drawn[1],
        name="latitude, longitude",
        legendgroup="graticule",
        line={"color": LINE, "width": 0.8},
        **SHARED,
    )
    yield _texts(
        labels, scale, name="latitude, longitude", legendgroup="graticule", textposition="top right"
    )


def ring_layer(
    radars: Sequence[RadarSite], x: Sequence[float], y: Sequence[float], scale: MapScale
) -> Iterator[Scatter]:
    """Yield rings of equal range about each radar, as one trace, and their labels.

    Parameters
    ----------
    radars : sequence of RadarSite
    x, y : sequences of two floats
        What the map first shows, in its unit.
    scale : MapScale
    """
    if not radars:
        return
    farthest = max(
        float(np.hypot(east - at[0], north - at[1]))
        for at in (scale.of_metres(np.array(radar.position)) for radar in radars)
        for east in x
        for north in y
    )
    step = _ring_step(farthest)
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS)
    lines: list[list[FloatArray]] = []
    labels: list[tuple[float, float, str]] = []
    for radar in radars:
        east, north = scale.of_metres(np.array(radar.position))
        for radius in np.arange(1, MOST_RINGS + 1) * step:
            if radius > farthest:
                break
            lines.append([east + radius * np.sin(angle), north + radius * np.cos(angle)])
            labels.append((float(east), float(north + radius), f"{radius:g} {scale.unit}"))
    drawn = _joined(lines, scale)
    yield Scatter(
        x=drawn[0],
        y=drawn[1],
        name="range rings",
        legendgroup="rings",
        line={"color": LINE, "width": 0.8, "dash": "dot"},
        **SHARED,
    )
    yield _texts(
        labels, scale, name="range rings", legendgroup="rings", textposition="bottom center"
    )


def _texts(labels: Sequence[tuple[float, float, str]], scale: MapScale, **given: str) -> Scatter:
    """Return the trace of texts at places of the map."""
    columns = [list(column) for column in zip(*labels, strict=True)] or [[], [], []]
    return Scatter(
        x=np.round(columns[0], scale.decimals).tolist(),
        y=np.round(columns[1], scale.decimals).tolist(),
        text=columns[2],
        **given,
        **LABEL,
    )


def place_texts(plane: Plane, position: FloatArray, height: FloatArray) -> list[str]:
    """Return latitudes, longitudes and, where they are known, heights as text.

    Parameters
    ----------
    plane : Plane
    position : array of shape (N, 2)
        In the plane, metres.
    height : array of shape (N,)
        Above the world's zero, metres; NaN where it is unknown.
    """
    latitude, longitude = plane.to_geodetic(position[:, 0], position[:, 1])
    return [
        f"{degrees(north, 1e-4, 'NS')}, {degrees(east, 1e-4, 'EW')}"
        + (f", height {up:.0f} m" if np.isfinite(up) else "")
        for north, east, up in zip(
            latitude.tolist(), longitude.tolist(), (height + plane.origin[2]).tolist(), strict=True
        )
    ]


def degrees(value: float, step: float, names: str) -> str:
    """Return an angle with the digits that a step needs and the letter of its side."""
    digits = max(int(np.ceil(-np.log10(step) - 1e-9)), 0)
    shown = (value + 180.0) % 360.0 - 180.0 if names == "EW" else value
    side = names[0] if round(shown, digits) >= 0.0 else names[1]
    return f"{abs(shown):.{digits}f}° {side}"


def _wider(x: Sequence[float], y: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest x and y that the lines go to, shape (2,) each."""
    low, high = np.array([x[0], y[0]]), np.array([x[1], y[1]])
    beyond = (high - low).max() * np.array([BEYOND_X, BEYOND_Y])
    return low - beyond, high + beyond


def _extent(plane: Plane, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest latitude and longitude in a rectangle, degrees."""
    grid = np.meshgrid(*(np.linspace(low[k], high[k], 41) for k in (0, 1)))
    latitude, longitude = plane.to_geodetic(*grid)
    # Counted from the origin, so that the antimeridian is no border.
    away = (longitude - plane.origin[1] + 180.0) % 360.0 - 180.0 + plane.origin[1]
    return (
        np.array([latitude.min(), latitude.max()]),
        np.array([away.min(), away.max()]),
    )


def _step(extent: FloatArray) -> float:
    """Return the least step that leaves at most `MOST_LINES` lines, degrees."""
    wide = float(extent[1] - extent[0])
    return min((step for step in STEPS if wide / step <= MOST_LINES), default=STEPS[0])


def _multiples(extent: FloatArray, step: float) -> FloatArray:
    first, last = np.ceil(extent[0] / step), np.floor(extent[1] / step)
    multiples: FloatArray = np.arange(first, last + 1.0) * step
    return multiples


def _ring_step(farthest: float) -> float:
    """Return a round step at which at most `MOST_RINGS` rings are within a distance."""
    power = 10.0 ** np.floor(np.log10(farthest / MOST_RINGS))
    return float(next(m * power for m in (*RING_STEPS, 10.0) if m * power >= farthest / MOST_RINGS))


def _joined(
    lines: Sequence[Sequence[FloatArray]], scale: MapScale
) -> tuple[list[float | None], list[float | None]]:
    """Return the x and the y of lines in one sequence each, with None between them."""
    x: list[float | None] = []
    y: list[float | None] = []
    # A tenth of what places have: nobody reads a number off these lines.
    digits = scale.decimals - 1
    for line in lines:
        for column, values in ((x, line[0]), (y, line[1])):
            column += [*np.round(values, digits).tolist(), None]
    return x, y
