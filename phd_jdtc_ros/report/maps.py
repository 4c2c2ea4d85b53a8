"""Maps of a run: true trajectories, detections, learned clutter, and smoothed estimates.

Metres or kilometres have equal scales; times count from the run's first stamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullFormatter

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates

from .record import Record, concatenate_rows
from .style import (
    DETECTION,
    DPI,
    INK,
    RADIUS_95,
    WIDTH_IN,
    Clock,
    MapScale,
    class_colour,
    class_line,
    class_marker,
    plain_axes,
    purples,
)

# Approximate number of ellipses and time dots per track.
MARKS_PER_TRACK = 10
# Clutter density of the palest colour, false detections per revolution and km^2.
CLUTTER_LEAST = 0.01
TIME_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)


class Track(NamedTuple):
    """One target's true trajectory; `position` of shape (scans, 2) in metres."""

    number: int
    class_id: int
    stamp_ns: list[int]
    position: FloatArray


def true_tracks(record: Record) -> list[Track]:
    """Return the trajectories of all targets, by number."""
    rows: dict[int, list[tuple[int, int, FloatArray]]] = {}
    for truth in record.truth:
        for number, class_id, place in zip(
            truth.track_id.tolist(), truth.class_id.tolist(), truth.position, strict=True
        ):
            rows.setdefault(number, []).append((truth.stamp_ns, class_id, place))
    return [
        Track(number, track[0][1], [t for t, _, _ in track], np.array([p for _, _, p in track]))
        for number, track in sorted(rows.items())
    ]


def scenario(record: Record) -> Figure:
    """Draw the true trajectories with class, number, lifetime, and dots at regular times."""
    tracks = true_tracks(record)
    clock = Clock.of(record)
    step_s = _dot_interval_s(clock.span_s)
    scale = MapScale.of(record)
    tracks = [track._replace(position=scale.of_metres(track.position)) for track in tracks]
    figure, axes = _map(np.concatenate([track.position for track in tracks]), scale, margin=0.1)
    labels = []
    for track in tracks:
        colour = class_colour(track.class_id)
        x, y = track.position.T
        axes.plot(x, y, class_line(track.class_id), color=colour, linewidth=1.6)
        time = clock.seconds(track.stamp_ns)
        dots = np.arange(np.ceil(time[0] / step_s), np.floor(time[-1] / step_s) + 1) * step_s
        axes.plot(np.interp(dots, time, x), np.interp(dots, time, y), ".", color=colour, ms=6)
        axes.plot(x[0], y[0], "o", color=colour, markerfacecolor="white", ms=7, mew=1.6, zorder=3)
        _arrow_head(axes, track.position, colour)
        life = clock.interval(time[0], time[-1])
        labels.append(_start_label(axes, track, f"{track.number}", life))
    _make_room(figure, axes, labels)
    handles = [
        _handle(record.sets.class_title(k), color=class_colour(k), ls=class_line(k), lw=1.6)
        for k in sorted({track.class_id for track in tracks})
    ]
    handles.append(_handle("start", marker="o", markerfacecolor="white", ls=""))
    handles.append(_handle(f"every {clock.text(step_s)}", marker=".", ls=""))
    _legend(axes, handles)
    return figure


def measurements(record: Record) -> Figure:
    """Draw all detections, high amplitudes on top, or in one colour without amplitudes."""
    scale = MapScale.of(record)
    position, amplitude = scale.of_metres(record.all_plots.position), record.all_plots.amplitude
    known = record.all_plots.known
    figure, axes = _map(position, scale, margin=0.02)
    if not known.all():
        x, y = position[~known].T
        axes.scatter(x, y, s=7.0, color=DETECTION, linewidths=0)
    if known.any():
        order = np.flatnonzero(known)[np.argsort(amplitude[known], kind="stable")]
        lowest, highest = amplitude[order[[0, -1]]]
        x, y = position[order].T
        dots = axes.scatter(
            x,
            y,
            c=amplitude[order],
            s=7.0,
            linewidths=0,
            # Its pale end is left out, because it is hard to see.
            cmap=LinearSegmentedColormap.from_list("pale_to_dark", purples(0.45, 1.0, 64)),
            norm=LogNorm(lowest, max(highest, 1.1 * lowest)),
        )
        _amplitude_bar(figure, axes, dots)
    return figure


def clutter(record: Record) -> Figure:
    """Draw the clutter map learned by the end of the run, and the true trajectories.

    Raises `ValueError` if the record has no clutter map.
    """
    if record.clutter is None:
        raise ValueError("clutter: None given, must be a raster")
    shown, scale = record.clutter, MapScale.of(record)
    edges = scale.of_metres(np.array(shown.extent))
    corners = edges.reshape(2, 2).T
    figure, axes = _map(corners, scale, margin=0.0)
    density = np.where(shown.density > 0.0, shown.density, np.nan)
    highest = max(float(np.nanmax(density)), 10.0 * CLUTTER_LEAST)
    image = axes.imshow(
        density,
        origin="lower",
        extent=tuple(edges.tolist()),
        norm=LogNorm(CLUTTER_LEAST, highest),
        cmap="YlOrBr",
        interpolation="nearest",
        zorder=1,
    )
    for track in true_tracks(record):
        axes.plot(*scale.of_metres(track.position).T, color=INK, linewidth=0.8, zorder=2)
    axes.set(xlim=edges[:2], ylim=edges[2:])
    axes.set_aspect("equal", adjustable="box")
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, aspect=32)
    bar.set_label("false detections per revolution and km² (log scale)")
    _legend(axes, [_handle("truth", lw=0.8)])
    return figure


def trajectories(record: Record) -> Figure:
    """Draw the smoothed estimates by class over the true trajectories."""
    scale = MapScale.of(record)
    lines = [scale.of_metres(track.position) for track in true_tracks(record)]
    position = scale.of_metres(concatenate_rows((found.position for found in record.smoothed), 2))
    figure, axes = _map(np.concatenate([position, *lines]), scale, margin=0.04)
    for line in lines:
        axes.plot(*line.T, color=INK, linewidth=0.6, zorder=1)
    step = max(1, round(len(record.smoothed) / MARKS_PER_TRACK))
    for index, estimates in enumerate(record.smoothed):
        if index % step == step // 2:
            _ellipses(axes, estimates, scale)
    class_id = concatenate_rows(found.class_id for found in record.smoothed)
    for k in range(record.classes):
        axes.plot(
            *position[class_id == k].T,
            class_marker(k),
            color=class_colour(k),
            markersize=3.2,
            markeredgewidth=0,
            label=record.sets.class_title(k),
        )
    handles, _ = axes.get_legend_handles_labels()
    if lines:
        handles.append(_handle("truth", lw=0.6))
    handles.append(_handle("95 % ellipse", marker="o", mfc="none", mew=0.8, ms=9, ls=""))
    _legend(axes, handles)
    return figure


def _map(position: FloatArray, scale: MapScale, margin: float) -> tuple[Figure, Axes]:
    """Return axes of equal scale, shaped for `position` of shape (T, 2) in the scale's unit."""
    width, height = np.maximum(np.ptp(position, axis=0), 0.1)
    figure = Figure(
        figsize=(WIDTH_IN, float(np.clip(WIDTH_IN * height / width, 4.0, 7.2))),
        dpi=DPI,
        layout="constrained",
    )
    axes = figure.add_subplot()
    axes.set(xlabel=f"x ({scale.unit})", ylabel=f"y ({scale.unit})")
    axes.margins(margin)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(_tick_step(float(max(width, height)))))
    axes.set_aspect("equal", adjustable="datalim")
    plain_axes(axes)
    return figure, axes


def _tick_step(extent: float) -> float:
    """Return the round step that divides `extent` into four to eight parts."""
    decade = 10.0 ** np.floor(np.log10(extent / 4.0))
    return float(
        max(step * decade for step in (1.0, 2.0, 2.5, 5.0) if 4.0 * step * decade <= extent)
    )


def _handle(label: str, **style: Any) -> Line2D:
    """Return an entry of a legend, in the colour of the text if no other is given."""
    return Line2D([], [], **{"color": INK, "label": label, **style})


def _legend(axes: Axes, handles: Sequence[Any]) -> None:
    """Place the legend above the axes, where it covers no data."""
    axes.legend(
        handles=list(handles),
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=5,
        frameon=False,
        borderaxespad=0.2,
        columnspacing=1.4,
        handletextpad=0.5,
    )


def _amplitude_bar(figure: Figure, axes: Axes, dots: PathCollection) -> None:
    bar = figure.colorbar(dots, ax=axes, shrink=0.8, pad=0.02, aspect=32)
    bar.set_label("amplitude (noise std, log scale)")
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())


def _arrow_head(axes: Axes, position: FloatArray, colour: str) -> None:
    """Mark the end of a track with an arrow along its last motion."""
    moved = np.flatnonzero(np.any(position != position[-1], axis=1))
    if len(moved):
        axes.annotate(
            "",
            xy=position[-1],
            xytext=position[moved[-1]],
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "shrinkA": 0.0,
                "shrinkB": 0.0,
                "mutation_scale": 14.0,
            },
        )


def _start_label(axes: Axes, track: Track, number: str, life: str) -> Annotation:
    """Write a track's number and lifetime beside its start, on the side away from its line."""
    heading = track.position[-1] - track.position[0]
    side = -1.0 if heading[0] >= 0.0 else 1.0
    return axes.annotate(
        f"{number}  ({life})",
        xy=track.position[0],
        xytext=(9.0 * side, 0.0),
        textcoords="offset points",
        ha="right" if side < 0.0 else "left",
        va="center",
        color=INK,
    )


def _make_room(figure: Figure, axes: Axes, labels: Sequence[Annotation]) -> None:
    """Widen a map until its labels are inside, which have the same size in any scale."""
    for label in labels:
        label.set_in_layout(False)
    figure.draw_without_rendering()
    to_data = axes.transData.inverted()
    boxes = [label.get_window_extent().transformed(to_data) for label in labels]
    first, last = axes.get_xlim()
    if all(first <= box.x0 and box.x1 <= last for box in boxes):
        return
    axes.update_datalim([[edge, box.y0] for box in boxes for edge in (box.x0, box.x1)])
    axes.autoscale_view()


def _ellipses(axes: Axes, estimates: Estimates, scale: MapScale) -> None:
    for position, covariance, class_id in zip(
        estimates.position,
        estimates.position_covariance,
        estimates.class_id.tolist(),
        strict=True,
    ):
        variance, axis = np.linalg.eigh(covariance / scale.metres**2)
        width, height = 2.0 * RADIUS_95 * np.sqrt(np.maximum(variance[::-1], 0.0))
        x, y = scale.of_metres(position)
        axes.add_patch(
            Ellipse(
                (x, y),
                width,
                height,
                angle=float(np.degrees(np.arctan2(axis[1, 1], axis[0, 1]))),
                fill=False,
                edgecolor=class_colour(class_id),
                linewidth=0.8,
            )
        )


def _dot_interval_s(span_s: float) -> float:
    """Return the round interval that gives a run of `span_s` seconds about ten dots."""
    fitting = (step for step in TIME_STEPS_S if span_s / step <= MARKS_PER_TRACK)
    return float(next(fitting, TIME_STEPS_S[-1]))
