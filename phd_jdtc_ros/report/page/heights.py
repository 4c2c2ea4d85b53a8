"""The page's charts of heights: over time, and from the side as ranges and elevations show them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from plotly.graph_objects import Figure, Scatter

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.report.style import Clock, MapScale

from ..record import RadarSite, Record
from ..style import class_colour
from .charts import NEUTRAL, Chart, rows_over_time, times


class HeightLine(NamedTuple):
    """A target or a track over time."""

    class_id: int
    stamp_ns: list[int]
    position: FloatArray  # Metres, (N, 2)
    height: FloatArray  # Metres above the world's zero, NaN where unknown, (N,)


def source_of(record: Record) -> str:
    """Return the source of the estimates that the charts show."""
    return SMOOTHED if record.smoothed else FILTERED


def height_lines(record: Record) -> list[HeightLine]:
    """Return the tracks whose heights are known."""
    rows: dict[int, list[tuple[int, int, float, float, float]]] = {}
    for found in record.of_source(source_of(record)):
        columns = zip(
            found.track_id.tolist(),
            found.class_id.tolist(),
            found.position.tolist(),
            found.known_attributes.height[:, 0].tolist(),
            strict=True,
        )
        for track, class_id, (x, y), height in columns:
            if not track:  # It has no label
                continue
            rows.setdefault(track, []).append((found.stamp_ns, class_id, x, y, height))
    return [*_height_lines(rows)]


def true_height_lines(record: Record) -> list[HeightLine]:
    """Return the true targets whose heights are known."""
    rows: dict[int, list[tuple[int, int, float, float, float]]] = {}
    for truth in record.truth:
        if truth.height is None:
            continue
        places, heights = truth.position.tolist(), truth.height[:, 0].tolist()
        numbers = truth.track_id.tolist(), truth.class_id.tolist()
        for track, class_id, (x, y), height in zip(*numbers, places, heights, strict=True):
            rows.setdefault(track, []).append((truth.stamp_ns, class_id, x, y, height))
    return [*_height_lines(rows)]


def _height_lines(
    rows: dict[int, list[tuple[int, int, float, float, float]]],
) -> Iterator[HeightLine]:
    for own in rows.values():
        # A line of more points is thinned, to keep the file small.
        kept = own[:: -(-len(own) // 400)]
        stamps, classes, *columns = zip(*kept, strict=True)
        x, y, height = np.array(columns)
        if np.isfinite(height).any():
            yield HeightLine(int(classes[-1]), [*stamps], np.stack([x, y], axis=1), height)


def heights_over_time(record: Record, tracks: list[HeightLine]) -> Chart:
    """Return the heights of tracks over time, and of the true targets."""
    time_caption = (
        "The heights of the {source} estimates{kind}. A line is a track in the colour of its "
        "class{truth}."
    )
    figure, clock = rows_over_time(record, ["height"], "height (m)"), Clock.of(record)
    truth, named = true_height_lines(record), set[str]()
    for path in truth:
        line = {"color": NEUTRAL, "width": 1.0, "dash": "dash"}
        _add(figure, 1, times(clock, path.stamp_ns), path.height, "truth", line, not named)
        named.add("truth")
    for path in tracks:
        name = record.sets.class_title(path.class_id)
        line = {"color": class_colour(path.class_id), "width": 1.4}
        x = times(clock, path.stamp_ns)
        _add(figure, 1, x, path.height, name, line, name not in named)
        named.add(name)
    figure.update_layout(hovermode="closest")
    in_space = any(found.space.vertical for found in record.of_source(source_of(record)))
    caption = time_caption.format(
        source=source_of(record),
        kind=", above the zero of the map" if in_space else ", as transponders report them",
        truth="; dashed lines are the truth" if truth else "",
    )
    return Chart("heights", "Heights over time", caption, figure)


def heights_from_the_side(record: Record, tracks: list[HeightLine]) -> Chart:
    """Return the tracks by distance and height from each radar whose antenna's height is known."""
    side_caption = (
        "The {source} estimates from the side of each radar: the distance along the ground and the "
        "height. Dashed lines are the limits of its elevations, without the curvature of the earth."
    )
    sites = [site for site in record.radars if math.isfinite(site.height)]
    figure, scale = (
        rows_over_time(record, [s.name for s in sites], "height (m)"),
        MapScale.of(record),
    )
    figure.update_xaxes(range=None, title=None)
    figure.update_xaxes(title={"text": f"distance ({scale.unit})"}, row=len(sites), col=1)
    named: set[str] = set()
    for row, site in enumerate(sites, 1):
        farthest = 0.0
        for path in tracks:
            name = record.sets.class_title(path.class_id)
            distance = np.hypot(*(path.position - np.array(site.position)).T)
            farthest = max(farthest, float(distance.max()))
            line = {"color": class_colour(path.class_id), "width": 1.2}
            x = np.round(scale.of_metres(distance), 4).tolist()
            _add(figure, row, x, path.height, name, line, name not in named)
            named.add(name)
        heights = np.concatenate([path.height for path in tracks])
        bottom, top = float(np.nanmin(heights)), float(np.nanmax(heights))
        # The heights decide on the axis: a limit of elevations goes far below the ground.
        margin = 0.05 * (max(top, site.height) - min(bottom, site.height)) + 1.0
        limits = [min(bottom, site.height) - margin, max(top, site.height) + margin]
        figure.update_yaxes(range=limits, row=row, col=1)
        for reach, y in _edges(site, farthest, top):
            x = scale.of_metres(reach).tolist()
            _add(figure, row, x, y, "limit", {"color": NEUTRAL, "width": 1.0, "dash": "dash"})
    figure.update_layout(hovermode="closest", meta="distance")
    caption = side_caption.format(source=source_of(record))
    return Chart("sides", "From the side of each radar", caption, figure)


def _edges(site: RadarSite, farthest: float, top: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the limits of a radar's elevations, up to a distance and a height, metres."""
    for elevation in site.elevations:
        if abs(elevation) >= 0.5 * math.pi:
            continue
        slope, reach = math.tan(elevation), farthest
        if slope > 0.0:
            reach = min(reach, max(top - site.height, 0.0) / slope)
        yield np.array([0.0, reach]), np.array([site.height, site.height + reach * slope])


def _add(
    figure: Figure,
    row: int,
    x: list[float],
    height: FloatArray,
    name: str,
    line: dict[str, object],
    shown: bool = False,
) -> None:
    figure.add_trace(
        Scatter(
            x=x,
            y=[None if math.isnan(each) else round(each, 2) for each in height.tolist()],
            name=name,
            legendgroup=name,
            showlegend=shown,
            mode="lines" if len(x) > 1 else "markers",
            line=line,
            hovertemplate=f"%{{y:.0f}} m {name}<extra></extra>",
        ),
        row=row,
        col=1,
    )
