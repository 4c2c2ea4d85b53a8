"""The pictures of a run: pure functions from a record and its scores to figures.

Maps are in kilometres with equal scales, times count from the run's first stamp. A class has the
same colour, line and marker in every picture; the palette (Okabe and Ito) survives colour-blind
eyes and the lines and markers survive a grey printer. Nothing here touches matplotlib's global
state, so figures can be drawn from any thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullFormatter

from phd_jdtc_ros.core.evaluation import FILTERED, SOURCES, Evaluation, ScanScore
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.core.types import Estimates, FloatArray

from .record import Record

WIDTH_IN = 8.0
DPI = 150

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
LINES = ("-", "--", "-.", ":")
MARKERS = ("o", "^", "s", "D", "v", "P")
INK, GREY, FAINT = "#222222", "#9A9A9A", "#E4E4E4"

# Squared radius that holds 95 % of a two-dimensional Gaussian.
CHI_SQUARE_95 = -2.0 * np.log(0.05)
# About so many ellipses and time dots a track are read without effort.
MARKS_PER_TRACK = 10
# From so many scans on, lines over time are drawn thin.
CROWDED = 400
TIME_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)


class Picture(NamedTuple):
    """A figure on disk.

    Parameters
    ----------
    title : str
    caption : str
        What it shows and what to look at.
    path : pathlib.Path
    """

    title: str
    caption: str
    path: Path


def write_all(record: Record, evaluation: Evaluation, directory: Path) -> list[Picture]:
    """Write every picture that the run has data for as a PNG, 1200 pixels wide.

    Parameters
    ----------
    record : Record
    evaluation : Evaluation
        The scores of `record`.
    directory : pathlib.Path
        Made if it does not exist.

    Returns
    -------
    list of Picture
        In the order in which to read them.
    """
    directory.mkdir(parents=True, exist_ok=True)
    pictures = []
    for chart in CHARTS:
        if chart.has_data(record, evaluation):
            path = directory / f"{chart.name}.png"
            FigureCanvasAgg(chart.draw(record, evaluation)).print_png(path)
            caption = chart.caption.format(p=evaluation.order, c=evaluation.cutoff)
            pictures.append(Picture(chart.title, caption, path))
    return pictures


# --- maps -----------------------------------------------------------------------------------------


def scenario(record: Record) -> Figure:
    """Draw the true trajectories: class, number, life, and where each was when."""
    tracks = _true_tracks(record)
    clock = Clock.of(record)
    step_s = _dot_interval_s(clock.span_s)
    figure, axes = _map(np.concatenate([track.position for track in tracks]), margin=0.1)
    for track in tracks:
        colour = _colour(track.class_id)
        x, y = track.position.T
        axes.plot(x, y, _line(track.class_id), color=colour, linewidth=1.6)
        time = clock.seconds(track.stamp_ns)
        dots = np.arange(np.ceil(time[0] / step_s), np.floor(time[-1] / step_s) + 1) * step_s
        axes.plot(np.interp(dots, time, x), np.interp(dots, time, y), ".", color=colour, ms=6)
        axes.plot(x[0], y[0], "o", color=colour, markerfacecolor="white", ms=7, mew=1.6, zorder=3)
        _arrow_head(axes, track.position, colour)
        _start_label(axes, track, f"{track.number}", clock.interval(time[0], time[-1]))
    handles = [
        Line2D([], [], color=_colour(k), linestyle=_line(k), linewidth=1.6, label=_class_name(k))
        for k in sorted({track.class_id for track in tracks})
    ]
    handles += [
        Line2D([], [], color=INK, marker="o", markerfacecolor="white", ls="", label="start"),
        Line2D([], [], color=INK, marker=".", ls="", label=f"every {clock.text(step_s)}"),
    ]
    _legend(axes, handles)
    return figure


def measurements(record: Record) -> Figure:
    """Draw all detections of all radars, the strong ones on top."""
    position = np.concatenate([plot.position for plot in record.plots]) / 1e3
    amplitude = np.concatenate([plot.amplitude for plot in record.plots])
    known = np.isfinite(amplitude) & (amplitude > 0.0)
    figure, axes = _map(position, margin=0.02)
    if not known.all():
        x, y = position[~known].T
        axes.scatter(x, y, s=7.0, color=GREY, linewidths=0)
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
            cmap=_pale_to_dark(),
            norm=LogNorm(lowest, max(highest, 1.1 * lowest)),
        )
        _amplitude_bar(figure, axes, dots)
    return figure


def trajectories(record: Record) -> Figure:
    """Draw the smoothed estimates by class over the true trajectories."""
    tracks = _true_tracks(record)
    position = _positions(record.smoothed)
    everything = np.concatenate([position, *(track.position for track in tracks)])
    figure, axes = _map(everything, margin=0.04)
    for track in tracks:
        axes.plot(*track.position.T, color=INK, linewidth=0.6, zorder=1)
    every = max(1, round(len(record.smoothed) / MARKS_PER_TRACK))
    for index, estimates in enumerate(record.smoothed):
        if index % every == every // 2:
            _ellipses(axes, estimates)
    class_id = _joined([estimates.class_id for estimates in record.smoothed], np.int64)
    for k in range(record.classes):
        axes.plot(
            *position[class_id == k].T,
            _marker(k),
            color=_colour(k),
            markersize=3.2,
            markeredgewidth=0,
            label=_class_name(k),
        )
    handles, _ = axes.get_legend_handles_labels()
    if tracks:
        handles.append(Line2D([], [], color=INK, linewidth=0.6, label="truth"))
    handles.append(
        Line2D(
            [], [], color=INK, marker="o", mfc="none", mew=0.8, ms=9, ls="", label="95 % ellipse"
        )
    )
    _legend(axes, handles)
    return figure


# --- over time ------------------------------------------------------------------------------------


def number_error(record: Record, evaluation: Evaluation) -> Figure:
    """Draw n_est - n_true over time, a row for each class."""
    panels = [
        Panel.of(record, evaluation, key, lambda score: score.n_est - score.n_true)
        for key in _class_keys(evaluation)
    ]
    figure, rows = _rows(record, len(panels), "estimated - true")
    for axes, panel in zip(rows, panels, strict=True):
        for source, (time, value) in panel.series.items():
            label = f"{source}, mean |error| {np.abs(value).mean():.3f}"
            if source == FILTERED:
                axes.fill_between(
                    time, value, step="mid", color=GREY, alpha=0.55, linewidth=0, label=label
                )
            else:
                axes.step(time, value, where="mid", color=panel.colour, linewidth=1.4, label=label)
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -1.2), max(high, 1.2))
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
        _row_header(axes, panel.title)
    return figure


def ospa(record: Record, evaluation: Evaluation) -> Figure:
    """Draw the OSPA distance over time, a row for each class and one for all."""
    panels = [
        Panel.of(record, evaluation, key, lambda score: score.ospa.distance)
        for key in (*_class_keys(evaluation), "all")
    ]
    return _distances(record, panels, "OSPA (m)")


def ospa_parts(record: Record, evaluation: Evaluation) -> Figure:
    """Draw the localisation and the cardinality part of the OSPA of all targets over time."""
    location = Panel.of(record, evaluation, "all", lambda score: score.ospa.localization)
    number = Panel.of(record, evaluation, "all", lambda score: score.ospa.cardinality)
    panels = [
        location._replace(title="all classes: localisation part"),
        number._replace(title="all classes: cardinality part"),
    ]
    return _distances(record, panels, "part of OSPA (m)")


def _distances(record: Record, panels: Sequence[Panel], label: str) -> Figure:
    """Draw one row a panel, filtered behind smoothed, each with its mean."""
    figure, rows = _rows(record, len(panels), label)
    for axes, panel in zip(rows, panels, strict=True):
        for source, (time, value) in panel.series.items():
            colour, width = (GREY, 1.1) if source == FILTERED else (panel.colour, 1.6)
            mean = value.mean()
            axes.plot(
                time,
                value,
                "-" if len(time) > 1 else ".",
                color=colour,
                linewidth=width if len(time) <= CROWDED else 0.5,
                label=f"{source}, mean {mean:.0f} m",
            )
            axes.axhline(mean, color=colour, linewidth=1.0, linestyle=(0, (5, 3)), zorder=3)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
        _row_header(axes, panel.title)
    highest = max(axes.dataLim.y1 for axes in rows)
    rows[0].set_ylim(0.0, 1.05 * highest if highest > 0.0 else 1.0)
    return figure


# --- what is drawn --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chart:
    """One kind of picture.

    Parameters
    ----------
    name : str
        Of the file, without suffix.
    title, caption : str
        The caption may use ``{p}`` and ``{c}``.
    has_data : callable of (Record, Evaluation)
    draw : callable of (Record, Evaluation)
    """

    name: str
    title: str
    caption: str
    has_data: Callable[[Record, Evaluation], bool]
    draw: Callable[[Record, Evaluation], Figure]


def _has_truth(record: Record, _: Evaluation) -> bool:
    return any(len(truth.state) for truth in record.truth)


def _has_detections(record: Record, _: Evaluation) -> bool:
    return any(len(plot.position) for plot in record.plots)


def _has_positions(record: Record, evaluation: Evaluation) -> bool:
    return _has_truth(record, evaluation) or any(len(run) for run in record.smoothed)


def _has_scores(_: Record, evaluation: Evaluation) -> bool:
    return any(evaluation.scores[source] for source in SOURCES)


CHARTS = (
    Chart(
        "scenario",
        "Scenario",
        "The true trajectories: colour and line are the class, the number is the target's, the "
        "circle its start, the arrow head its end. Look for where trajectories cross or run side "
        "by side: dots of equal time show whether the targets were there together.",
        _has_truth,
        lambda record, _: scenario(record),
    ),
    Chart(
        "measurements",
        "Detections",
        "All detections of all radars over the whole run, in the world frame. Darker is stronger. "
        "Clutter is pale, spread over the whole coverage and densest near the radars; the trail "
        "of a strong target is dark, that of a weak one paler.",
        _has_detections,
        lambda record, _: measurements(record),
    ),
    Chart(
        "trajectories",
        "Estimated trajectories",
        "Smoothed estimates, coloured by estimated class, over the true trajectories where they "
        "are known; a few estimates carry the ellipse that holds 95 % of their probability. "
        "Look for points of the other colour on a trajectory (a wrong class), points off every "
        "trajectory (a false target) and gaps (a missed one).",
        _has_positions,
        lambda record, _: trajectories(record),
    ),
    Chart(
        "number_error",
        "Number of targets, error by class",
        "Estimated minus true number of targets. Zero is right, below is a missed target, above a "
        "false one. Grey spikes without a coloured line over them are errors of the filter that "
        "the smoother repaired; opposite spikes in two classes at one time are one target taken "
        "for the other class.",
        _has_scores,
        number_error,
    ),
    Chart(
        "ospa",
        "OSPA distance by class and of all targets",
        "OSPA distance (p = {p:g}, c = {c:g} m) of filtered and smoothed estimates; dashed lines "
        "are the means over the run. Lower is better. Peaks are scans with a wrong number of "
        "targets, the level between them is the error in position.",
        _has_scores,
        ospa,
    ),
    Chart(
        "ospa_parts",
        "What the OSPA distance is made of",
        "The same distance of all targets in two parts: position errors of matched targets, and "
        "missing or false targets. For p = {p:g} the p-th powers of the parts add. It tells "
        "whether smoothing gained in position, in number, or in both.",
        _has_scores,
        ospa_parts,
    ),
)


@dataclass(frozen=True)
class Clock:
    """Time from a run's first stamp, in a unit that suits its length.

    Parameters
    ----------
    origin_ns : int
    span_s : float
    """

    origin_ns: int
    span_s: float

    @staticmethod
    def of(record: Record) -> Clock:
        """Return the clock that starts with the record's first stamp."""
        parts: tuple[Iterable[Any], ...] = (
            record.truth,
            record.plots,
            record.filtered,
            record.smoothed,
        )
        stamps = [item.stamp_ns for part in parts for item in part]
        if not stamps:
            return Clock(0, 0.0)
        return Clock(min(stamps), (max(stamps) - min(stamps)) * 1e-9)

    @property
    def unit(self) -> str:
        """Seconds, or minutes for runs of more than half an hour."""
        return "s" if self.span_s <= 1800.0 else "min"

    @property
    def unit_s(self) -> float:
        """Length of the unit."""
        return 1.0 if self.unit == "s" else 60.0

    def seconds(self, stamp_ns: Sequence[int]) -> FloatArray:
        """Return seconds from the origin; the difference is taken in integers."""
        return np.array([stamp - self.origin_ns for stamp in stamp_ns], dtype=np.int64) * 1e-9

    def number(self, seconds: float) -> str:
        """Return a time without its unit."""
        return f"{round(seconds / self.unit_s, 1):g}"

    def text(self, seconds: float) -> str:
        """Return a time with its unit."""
        return f"{self.number(seconds)} {self.unit}"

    def interval(self, first_s: float, last_s: float) -> str:
        """Return two times with their unit."""
        return f"{self.number(first_s)} to {self.text(last_s)}"


class Panel(NamedTuple):
    """One row of a figure over time.

    Parameters
    ----------
    title, colour : str
    series : dict
        Per source the times in the clock's unit and the values; no entry without scores.
    """

    title: str
    colour: str
    series: dict[str, tuple[FloatArray, FloatArray]]

    @staticmethod
    def of(
        record: Record, evaluation: Evaluation, key: str, value: Callable[[Any], float]
    ) -> Panel:
        """Return the scores of the set `key` as `value` reads them."""
        clock = Clock.of(record)
        series = {}
        for source in SOURCES:
            scans: list[ScanScore] = [scan for _, scan in sorted(evaluation.scores[source].items())]
            if scans:
                time = clock.seconds([scan.stamp_ns for scan in scans]) / clock.unit_s
                series[source] = time, np.array([float(value(s.scores[key])) for s in scans])
        if key == "all":
            return Panel("all classes", INK, series)
        number = int(key.removeprefix("class_"))
        return Panel(_class_name(number), _colour(number), series)


class Track(NamedTuple):
    """One target's true trajectory; `position` of shape (scans, 2) in kilometres."""

    number: int
    class_id: int
    stamp_ns: list[int]
    position: FloatArray


def _true_tracks(record: Record) -> list[Track]:
    rows: dict[int, list[tuple[int, int, FloatArray]]] = {}
    for truth in record.truth:
        position = truth.state[:, list(POSITION)] / 1e3
        for number, class_id, place in zip(
            truth.track_id.tolist(), truth.class_id.tolist(), position, strict=True
        ):
            rows.setdefault(number, []).append((truth.stamp_ns, class_id, place))
    return [
        Track(number, track[0][1], [t for t, _, _ in track], np.array([p for _, _, p in track]))
        for number, track in sorted(rows.items())
    ]


def _positions(run: Sequence[Estimates]) -> FloatArray:
    """Return the positions of all estimates in kilometres, shape (T, 2)."""
    states = [estimates.state[:, list(POSITION)] for estimates in run]
    return _joined(states, np.float64).reshape(-1, 2) / 1e3


def _joined(arrays: Sequence[Any], dtype: type) -> Any:
    return np.concatenate([*arrays, np.zeros((0, *arrays[0].shape[1:]) if arrays else 0, dtype)])


# --- how it is drawn ------------------------------------------------------------------------------


def _class_keys(evaluation: Evaluation) -> list[str]:
    return [f"class_{k}" for k in range(evaluation.classes)]


def _class_name(class_id: int) -> str:
    return f"class {class_id}"


def _colour(class_id: int) -> str:
    return COLOURS[class_id % len(COLOURS)]


def _line(class_id: int) -> str:
    return LINES[class_id % len(LINES)]


def _marker(class_id: int) -> str:
    return MARKERS[class_id % len(MARKERS)]


def _pale_to_dark() -> LinearSegmentedColormap:
    """Return a map of one rising darkness, without the yellow end that a white page drowns."""
    shades = colormaps["YlGnBu"](np.linspace(0.3, 1.0, 64))
    return LinearSegmentedColormap.from_list("pale_to_dark", shades)


def _map(position: FloatArray, margin: float) -> tuple[Figure, Axes]:
    """Return axes in kilometres of equal scale, shaped for `position` of shape (T, 2)."""
    width, height = np.maximum(np.ptp(position, axis=0), 0.1)
    figure = Figure(
        figsize=(WIDTH_IN, float(np.clip(WIDTH_IN * height / width, 4.0, 7.2))),
        dpi=DPI,
        layout="constrained",
    )
    axes = figure.add_subplot()
    axes.set(xlabel="x (km)", ylabel="y (km)")
    axes.margins(margin)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(_tick_step(float(max(width, height)))))
    axes.set_aspect("equal", adjustable="datalim")
    _plain(axes)
    return figure, axes


def _tick_step(extent: float) -> float:
    """Return the round step that divides `extent` into four to eight."""
    decade = 10.0 ** np.floor(np.log10(extent / 4.0))
    return float(
        max(step * decade for step in (1.0, 2.0, 2.5, 5.0) if 4.0 * step * decade <= extent)
    )


def _rows(record: Record, rows: int, label: str) -> tuple[Figure, list[Axes]]:
    """Return rows of axes over time that share both scales."""
    clock = Clock.of(record)
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 1.75 * rows), dpi=DPI, layout="constrained")
    column = figure.subplots(rows, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes in column:
        _plain(axes)
        axes.set_ylabel(label)
    column[-1].set_xlabel(f"time from the first scan ({clock.unit})")
    span = max(clock.span_s, 1.0) / clock.unit_s
    column[-1].set_xlim(-0.01 * span, 1.01 * span)
    return figure, list(column)


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def _legend(axes: Axes, handles: Sequence[Any]) -> None:
    """Put the legend above the axes, where it hides nothing."""
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


def _row_header(axes: Axes, title: str) -> None:
    """Put the row's name and its legend above it."""
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncol=2,
            frameon=False,
            fontsize=9,
            borderaxespad=0.1,
        )


def _amplitude_bar(figure: Figure, axes: Axes, dots: PathCollection) -> None:
    bar = figure.colorbar(dots, ax=axes, shrink=0.8, pad=0.02, aspect=32)
    bar.set_label("amplitude (noise std, log scale)")
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())


def _arrow_head(axes: Axes, position: FloatArray, colour: str) -> None:
    """Mark the end of a track, pointing the way it went."""
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


def _start_label(axes: Axes, track: Track, number: str, life: str) -> None:
    """Write a track's number and life behind its start, off its line."""
    heading = track.position[-1] - track.position[0]
    side = -1.0 if heading[0] >= 0.0 else 1.0
    axes.annotate(
        f"{number}  ({life})",
        xy=track.position[0],
        xytext=(9.0 * side, 0.0),
        textcoords="offset points",
        ha="right" if side < 0.0 else "left",
        va="center",
        color=INK,
    )


def _ellipses(axes: Axes, estimates: Estimates) -> None:
    """Draw the 95 % ellipse of every estimate's position."""
    index = np.ix_(POSITION, POSITION)
    for state, covariance, class_id in zip(
        estimates.state, estimates.covariance, estimates.class_id.tolist(), strict=True
    ):
        variance, axis = np.linalg.eigh(covariance[index] * 1e-6)
        width, height = 2.0 * np.sqrt(CHI_SQUARE_95 * np.maximum(variance[::-1], 0.0))
        axes.add_patch(
            Ellipse(
                state[list(POSITION)] / 1e3,
                width,
                height,
                angle=float(np.degrees(np.arctan2(axis[1, 1], axis[0, 1]))),
                fill=False,
                edgecolor=_colour(class_id),
                linewidth=0.8,
            )
        )


def _dot_interval_s(span_s: float) -> float:
    """Return the round interval that marks a run of `span_s` about ten times."""
    fitting = [step for step in TIME_STEPS_S if span_s / step <= MARKS_PER_TRACK]
    return float(fitting[0] if fitting else TIME_STEPS_S[-1])
