"""The page's interactive charts: scores, numbers, class probabilities and heights.

Charts are transparent and take the colours of text, rules and neutral lines from the page, light or
dark. Only classes and amplitudes have fixed colours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates, Truth
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.report.style import Clock, MapScale, metres_text, round_step

from ..record import RadarSite, Record, Sets, class_of
from ..style import class_colour

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


def ospa(record: Record, evaluation: Evaluation) -> Chart:
    """Return the OSPA distance over time, one row for all targets and one per class."""
    ospa_caption = (
        "OSPA distance (p = {p:g}, c = {c:g} m) of the filtered and of the smoothed estimates to "
        "the truth. Lower is better. Peaks are scans with a wrong number of targets; the level "
        "between them is the position error."
    )
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
    caption = ospa_caption.format(p=evaluation.order, c=evaluation.cutoff)
    return Chart("ospa", "OSPA distance over time", caption, figure)


def numbers(record: Record) -> Chart:
    """Return the number of targets over time, one row for all targets and one per class."""
    band = "rgba(133,133,133,0.22)"
    number_caption = (
        "The number of targets{in_all}. {truth}{classes}Spikes of the filter only are errors that "
        "the smoother has repaired."
    )
    of_classes = "Opposite spikes in two classes at one time are a target with the wrong class. "
    true_number = "The grey area is the true number. "
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
                    fillcolor=band,
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
    caption = number_caption.format(
        in_all=", in all and per class" if several else "",
        truth=true_number if record.truth else "",
        classes=of_classes if several else "",
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
            meta="ink" if smoothed and key == ALL else None,
            line={"color": colour, "width": 2.0 if smoothed else 1.2, "shape": shape},
            hovertemplate=f"%{{y}}{unit} {source}<extra></extra>",
        ),
        row=row,
        col=1,
    )


CAPTION = (
    "The probability of each class for every estimate, one row per class. {colours} Near 0 or 1 "
    "the class is certain; in between, amplitudes and motion have not determined it yet."
)


class Key(NamedTuple):
    """Identifies the estimates of one curve."""

    name: str  # Text in the legend
    label: str  # Text at a single curve
    class_id: int | None  # Determines the colour; None for no class
    number: int  # Number of the target or the track; 0 for none, whose points are not joined


class Curve(NamedTuple):
    """Class probabilities of one curve: stamps and arrays of shape (C,)."""

    stamp_ns: list[int]
    probability: list[FloatArray]


def class_probabilities(record: Record, evaluation: Evaluation) -> Chart:
    """Return the class probabilities of all estimates over time, one row per class."""
    by_truth = (
        "The colour is the true class of the target paired with the estimate, and a line is one "
        "target; grey crosses are estimates without a target nearby."
    )
    by_estimate = "The colour is the estimated class."
    clock = Clock.of(record)
    names = [f"P({record.sets.class_title(k)})" for k in range(record.classes)]
    figure = rows_over_time(record, names, "probability")
    main = SMOOTHED if record.smoothed else FILTERED
    curves = _curves(record, main, evaluation.cutoff)
    if main == SMOOTHED and record.filtered:
        shares = np.concatenate([found.class_probability for found in record.filtered])
        stamps = [found.stamp_ns for found in record.filtered for _ in range(len(found))]
        curves = {Key(FILTERED, FILTERED, None, 0): Curve(stamps, list(shares)), **curves}
    named: set[str] = set()
    for key, curve in curves.items():
        for k, row in enumerate(names):
            trace = Scatter(
                x=times(clock, curve.stamp_ns),
                y=[round(float(share[k]), 4) for share in curve.probability],
                showlegend=key.name not in named,
                hovertemplate=f"{key.label}<br>{row} = %{{y:.3f}}<extra></extra>",
                **_style(key),
            )
            figure.add_trace(trace, row=k + 1, col=1)
            named.add(key.name)
    figure.update_yaxes(range=[-0.05, 1.05], tickvals=[0, 0.5, 1])
    caption = CAPTION.format(colours=by_truth if record.truth else by_estimate)
    return Chart("classes", "Class probabilities over time", caption, figure)


def _style(key: Key) -> dict[str, Any]:
    """Return the style of a curve: its class's colour, or grey behind the others."""
    # Plotly's names for the markers of classes that the pictures use.
    symbols = ("circle", "triangle-up", "square", "diamond", "triangle-down", "cross")
    shared = {"name": key.name, "legendgroup": key.name}
    if key.class_id is None:
        symbol, size = ("circle-open", 5) if key.name == FILTERED else ("x-thin-open", 7)
        marker = {"symbol": symbol, "size": size, "color": NEUTRAL}
        return {**shared, "mode": "markers", "marker": marker}
    colour = class_colour(key.class_id)
    return {
        **shared,
        "mode": "lines+markers" if key.number else "markers",
        "line": {"color": colour, "width": 1.3},
        "marker": {"symbol": symbols[key.class_id % len(symbols)], "size": 4, "color": colour},
    }


def _curves(record: Record, source: str, cutoff: float) -> dict[Key, Curve]:
    """Return the estimates of a source by true target, or by estimated class without truth."""
    truth = {entry.stamp_ns: entry for entry in record.truth}
    curves: dict[Key, Curve] = {}
    for found in record.of_source(source):
        keys = (
            _by_target(source, found, truth.get(found.stamp_ns), cutoff, record.sets)
            if record.truth
            else _by_estimate(source, found, record.sets)
        )
        for key, probability in zip(keys, found.class_probability, strict=True):
            curve = curves.setdefault(key, Curve([], []))
            curve.stamp_ns.append(found.stamp_ns)
            curve.probability.append(probability)
    return dict(sorted(curves.items(), key=lambda item: (item[0].name, item[0].number)))


def _by_target(
    source: str, found: Estimates, targets: Truth | None, cutoff: float, sets: Sets
) -> Iterator[Key]:
    """Yield the key of each estimate, by the target that it is paired with."""
    paired: dict[int, int] = {}
    if targets is not None:
        index, estimate = assign(targets.position, found.position, cutoff)
        paired = dict(zip(estimate.tolist(), index.tolist(), strict=True))
    for row in range(len(found)):
        if targets is None or row not in paired:
            yield Key(f"{source}, near no target", "near no target", None, 0)
            continue
        number = int(targets.track_id[paired[row]])
        class_id = int(targets.class_id[paired[row]])
        truly = f"truly {sets.class_title(class_id)}"
        yield Key(f"{source}, {truly}", f"target {number}, {truly}", class_id, number)


def _by_estimate(source: str, found: Estimates, sets: Sets) -> Iterator[Key]:
    """Yield the key of each estimate, by its class and its track."""
    for class_id, number in zip(found.class_id.tolist(), found.track_id.tolist(), strict=True):
        name = sets.class_title(class_id)
        label = f"track {number}, {name}" if number else f"estimated {name}"
        yield Key(f"{source}, {name}", label, class_id, number)


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
    # An estimate without a label is of no track.
    sets = (found.select(found.track_id != 0) for found in record.of_source(source_of(record)))
    return _height_lines((found, found.known_attributes.height) for found in sets)


def true_height_lines(record: Record) -> list[HeightLine]:
    """Return the true targets whose heights are known."""
    known = ((truth, truth.height) for truth in record.truth)
    return _height_lines((truth, height) for truth, height in known if height is not None)


def _height_lines(sets: Iterable[tuple[Estimates | Truth, FloatArray]]) -> list[HeightLine]:
    rows: dict[int, list[tuple[int, int, float, float, float]]] = {}
    for found, heights in sets:
        columns = found.track_id, found.class_id, found.position, heights[:, 0]
        for track, class_id, (x, y), height in zip(*(c.tolist() for c in columns), strict=True):
            rows.setdefault(track, []).append((found.stamp_ns, class_id, x, y, height))
    lines = []
    for own in rows.values():
        # A line of more points is thinned, to keep the file small.
        kept = own[:: -(-len(own) // 400)]
        stamps, classes, *values = zip(*kept, strict=True)
        x, y, height = np.array(values)
        if np.isfinite(height).any():
            lines.append(HeightLine(classes[-1], [*stamps], np.stack([x, y], axis=1), height))
    return lines


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
