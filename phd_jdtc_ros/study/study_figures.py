"""The pictures and tables of a Monte Carlo study: pure functions from its results.

Colours, lines and markers are those of a single run's pictures. Lines over time are means over
runs; the bands about them are 95 % intervals of these means.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter
from rich.markup import escape
from rich.table import Table
from scipy import stats

from phd_jdtc_ros.core.types import FloatArray

from .figures import Picture
from .monte_carlo import ALL, CUTOFF, ORDER, OURS, REFERENCE, Mean, Result, slug
from .style import COLOURS, DPI, GREY, INK, LINES, MARKERS, WIDTH_IN, plain_axes

# The lag over time is this one, or the largest below it that the study has.
SHOWN_LAG = 5
CONFIDENCE = 0.95

# A figure by name, lag and set, over runs and time: shape (runs, scans).
OverTime: TypeAlias = Callable[[str, int, str], FloatArray]


def write_all(results: Sequence[Result], directory: Path) -> list[Picture]:
    """Write every picture of a study as a PNG, 1200 pixels wide, a directory for each case.

    Parameters
    ----------
    results : sequence of Result
    directory : pathlib.Path
        Made if it does not exist.

    Returns
    -------
    list of Picture
        Case by case, in the order in which to read them.
    """
    pictures = []
    for case in dict.fromkeys(result.case for result in results):
        here = [result for result in results if result.case == case]
        for chart in CHARTS:
            if chart.has_data(here):
                path = directory / slug(case) / f"{chart.name}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                FigureCanvasAgg(chart.draw(here)).print_png(path)
                pictures.append(Picture(f"{case}: {chart.title}", chart.caption, path))
    return pictures


# --- over time ------------------------------------------------------------------------------------


def ospa_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of filter and smoother, a row for each class and one for all."""
    main = _main(results)
    keys = [*_classes(main), ALL]
    figure, rows = _rows(main, keys, "OSPA (m)")
    for axes, key in zip(rows, keys, strict=True):
        _both(axes, main, key, "ospa", main.value, "{:.0f} m")
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    _from_zero(rows)
    return figure


def parts_over_time(results: Sequence[Result]) -> Figure:
    """Draw the localisation and the cardinality part of the mean OSPA of all targets."""
    main = _main(results)
    titles = {
        "localization": "all classes: localisation part",
        "cardinality": "all classes: cardinality part",
    }
    figure, rows = _rows(main, list(titles), "part of OSPA (m)")
    for axes, (name, title) in zip(rows, titles.items(), strict=True):
        _both(axes, main, ALL, name, main.value, "{:.0f} m", title)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    _from_zero(rows)
    return figure


def number_error_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean of |n_est - n_true|, a row for each class and one for all."""
    main = _main(results)
    keys = [*_classes(main), ALL]
    figure, rows = _rows(main, keys, "|number error|")
    for axes, key in zip(rows, keys, strict=True):
        _both(axes, main, key, "cardinality_abs_error", _number_error(main), "{:.3f}")
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    _from_zero(rows)
    return figure


def class_accuracy_over_time(results: Sequence[Result]) -> Figure:
    """Draw the share of matched targets with the right class, a row for each class and all."""
    main = _main(results)
    keys = [*_classes(main), ALL]
    figure, rows = _rows(main, keys, "right class")
    for axes, key in zip(rows, keys, strict=True):
        _both(axes, main, key, "class_accuracy", _class_accuracy(main), "{:.2%}")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    lowest = np.nanmin([np.nan_to_num(line.get_ydata(), nan=1.0) for a in rows for line in a.lines])
    span = max(1.3 * (1.0 - lowest), 0.02)
    rows[0].set_ylim(1.0 - span, 1.0 + 0.05 * span)
    return figure


def _number_error(result: Result) -> OverTime:
    def error(_: str, lag: int, key: str) -> FloatArray:
        return np.abs(result.value("n_est", lag, key) - result.value("n_true", lag, key))

    return error


def _class_accuracy(result: Result) -> OverTime:
    def accuracy(_: str, lag: int, key: str) -> FloatArray:
        pairs, right = (result.value(name, lag, key) for name in ("pairs", "right_class"))
        return np.divide(right, pairs, out=np.full(pairs.shape, np.nan), where=pairs > 0)

    return accuracy


# --- over the lag ---------------------------------------------------------------------------------


def ospa_against_lag(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of all targets against the lag, a line for each variant."""
    figure = Figure(figsize=(WIDTH_IN, 5.2), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    plain_axes(axes)
    styles = _styles(results)
    for result in results:
        lags = result.scores.lags
        means = [Mean.of(result.figure("ospa", lag)) for lag in lags]
        axes.errorbar(
            lags,
            [mean.mean for mean in means],
            yerr=[np.nan_to_num(mean.half_width) for mean in means],
            label=result.variant.name,
            capsize=2.5,
            elinewidth=0.9,
            **styles[result.variant.name],
        )
    axes.set(xlabel="lag (scans)", ylabel="mean OSPA (m)")
    _frame_means(axes, results)
    axes.set_xticks(sorted({lag for result in results for lag in result.scores.lags}))
    figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    return figure


def _frame_means(axes: Axes, results: Sequence[Result]) -> None:
    """Let the scale begin at zero and hold all means; the bars of few runs may leave it."""
    means = [
        Mean.of(result.figure("ospa", lag)).mean for result in results for lag in result.scores.lags
    ]
    axes.set_ylim(0.0, 1.15 * max(means) if max(means) > 0.0 else 1.0)


def _styles(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Return how each variant is drawn; the reference is no contender and is drawn apart."""
    styles: dict[str, dict[str, Any]] = {}
    contenders = [result.variant for result in results if result.variant.kind != REFERENCE]
    for index, variant in enumerate(contenders):
        styles[variant.name] = {
            "color": COLOURS[index % len(COLOURS)],
            # Shifted where the colours begin anew.
            "marker": MARKERS[(index + index // len(COLOURS)) % len(MARKERS)],
            "linestyle": LINES[index // len(COLOURS) % len(LINES)],
            "linewidth": 2.2 if index == 0 else 1.4,
            "markersize": 5.5,
        }
    for result in results:
        if result.variant.kind == REFERENCE:
            styles[result.variant.name] = {"color": INK, "linestyle": (0, (5, 3)), "linewidth": 1.4}
    return styles


# --- what is drawn --------------------------------------------------------------------------------


class Chart(NamedTuple):
    """One kind of picture of a case.

    Parameters
    ----------
    name : str
        Of the file, without suffix.
    title, caption : str
    has_data : callable of the case's results
    draw : callable of the case's results
    """

    name: str
    title: str
    caption: str
    has_data: Callable[[Sequence[Result]], bool]
    draw: Callable[[Sequence[Result]], Figure]


def _has_main(results: Sequence[Result]) -> bool:
    return any(result.variant.kind == OURS for result in results)


def _main(results: Sequence[Result]) -> Result:
    """Return the study's first variant of this package's tracker."""
    return next(result for result in results if result.variant.kind == OURS)


CHARTS = (
    Chart(
        "ospa_against_lag",
        "OSPA distance against lag",
        "Mean OSPA distance of all targets over runs and scans against the number of later scans "
        "that an estimate has seen; lag 0 is the filter. Bars are 95 % intervals. The dashed "
        "line is a smoother that is told which detection is whose: nothing can come far below it.",
        bool,
        ospa_against_lag,
    ),
    Chart(
        "ospa_over_time",
        "OSPA distance over time",
        "Mean over runs of filter and smoother, by class and of all targets; bands are 95 % "
        "intervals of the mean. Peaks are where targets appear, cross or vanish.",
        _has_main,
        ospa_over_time,
    ),
    Chart(
        "parts_over_time",
        "What the OSPA distance is made of",
        "The localisation and the cardinality part of the same distance.",
        _has_main,
        parts_over_time,
    ),
    Chart(
        "number_error_over_time",
        "Number of targets, absolute error",
        "Mean over runs of the absolute error of the number of targets.",
        _has_main,
        number_error_over_time,
    ),
    Chart(
        "class_accuracy_over_time",
        "Right class",
        "Share of the targets with an estimate nearby whose estimate has their class.",
        _has_main,
        class_accuracy_over_time,
    ),
)


# --- tables ---------------------------------------------------------------------------------------


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield a table of the mean OSPA by variant and lag for each case, and one of the goals."""
    for case, variants in summary["cases"].items():
        lags = _all_lags(variants)
        table = Table(title=f"{escape(case)}: mean OSPA in m, by lag in scans")
        table.add_column("variant")
        table.add_column("runs", justify="right")
        for lag in lags:
            table.add_column(lag, justify="right")
        for name, row in _ospa_rows(variants, lags, _number):
            table.add_row(escape(name), *row)
        yield table
    goals = [goal for goal in summary["goals"] if goal["reached"] is not None]
    if goals:
        table = Table(title="goals")
        for heading in ("goal", "value", "bound", ""):
            table.add_column(heading)
        for goal in goals:
            table.add_row(*map(escape, _goal_row(goal)), style=None if goal["reached"] else "red")
        yield table


def markdown(summary: Mapping[str, Any]) -> str:
    """Return the tables of `tables` as Markdown."""
    lines = []
    for case, variants in summary["cases"].items():
        lags = _all_lags(variants)
        what = (
            f"Mean OSPA (p = {ORDER:g}, c = {CUTOFF:g} m) in metres by lag in scans, 95 % interval."
        )
        lines += [f"## {case}", "", what, ""]
        lines += _markdown_row(["variant", "runs", *lags])
        lines += _markdown_row(["---", *["---:"] * (1 + len(lags))])
        for name, row in _ospa_rows(variants, lags, _with_interval):
            lines += _markdown_row([name, *row])
        lines.append("")
    lines += ["## Goals", ""]
    lines += _markdown_row(["goal", "value", "bound", "reached"]) + _markdown_row(["---"] * 4)
    for goal in summary["goals"]:
        lines += _markdown_row(_goal_row(goal))
    return "\n".join(lines) + "\n"


def _all_lags(variants: Mapping[str, Any]) -> list[str]:
    return sorted({lag for found in variants.values() for lag in found["lags"]}, key=int)


def _ospa_rows(
    variants: Mapping[str, Any], lags: Sequence[str], text: Callable[[Mapping[str, Any]], str]
) -> Iterator[tuple[str, list[str]]]:
    """Yield each variant's name, number of runs and mean OSPA at every lag."""
    for name, found in variants.items():
        means = [found["lags"][lag][ALL]["ospa"] if lag in found["lags"] else None for lag in lags]
        cells = ["-" if mean is None else text(mean) for mean in means]
        yield name, [str(found["runs"]), *cells]


def _number(mean: Mapping[str, Any]) -> str:
    return f"{mean['mean']:.1f}"


def _with_interval(mean: Mapping[str, Any]) -> str:
    interval = mean["interval_95"]
    return _number(mean) + (f" ± {interval[1] - mean['mean']:.1f}" if interval else "")


def _goal_row(goal: Mapping[str, Any]) -> list[str]:
    value, bound = ("-" if goal[key] is None else f"{goal[key]:.4g}" for key in ("value", "goal"))
    sign = "at most" if goal["at_most"] else "at least"
    reached = {True: "yes", False: "no", None: "-"}[goal["reached"]]
    return [goal["name"], value, f"{sign} {bound}", reached]


def _markdown_row(cells: Sequence[str]) -> list[str]:
    return [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"]


# --- how it is drawn ------------------------------------------------------------------------------


def _classes(result: Result) -> list[str]:
    return [key for key in result.scores.sets if key != ALL]


def _shown_lags(result: Result) -> list[tuple[int, str]]:
    """Return the lags to draw over time, with their names."""
    lags = result.scores.lags
    later = [lag for lag in lags if 0 < lag <= SHOWN_LAG] or [lag for lag in lags if lag > 0]
    names = [(0, "filter")] if 0 in lags else []
    return names + ([(max(later), f"smoother, lag {max(later)}")] if later else [])


def _both(
    axes: Axes,
    result: Result,
    key: str,
    name: str,
    value: OverTime,
    number: str,
    title: str | None = None,
) -> None:
    """Draw a figure of filter and smoother over time, with its band and its overall mean.

    Parameters
    ----------
    axes : Axes
    result : Result
    key : str
        The set, which has its colour.
    name : str
        Of the figure.
    value : callable
        Returns the figure over time.
    number : str
        How the mean is written.
    title : str or None
        The set's name if None.
    """
    colour = INK if key == ALL else COLOURS[int(key.removeprefix("class_")) % len(COLOURS)]
    time_s = result.scores.time_s
    for lag, label in _shown_lags(result):
        mean, half_width = _band(value(name, lag, key))
        low, high = mean - half_width, mean + half_width
        if name == "class_accuracy":
            low, high = np.maximum(low, 0.0), np.minimum(high, 1.0)
        shade, width, alpha = (GREY, 1.2, 0.2) if lag == 0 else (colour, 1.6, 0.25)
        axes.fill_between(time_s, low, high, color=shade, alpha=alpha, linewidth=0)
        overall = Mean.of(result.figure(name, lag, key)).mean
        axes.plot(
            time_s,
            mean,
            "-" if len(time_s) > 1 else ".",
            color=shade,
            linewidth=width,
            label=f"{label}, mean {number.format(overall)}" if np.isfinite(overall) else label,
        )
    default = "all classes" if key == ALL else key.replace("_", " ")
    axes.set_title(title or default, loc="left", fontsize=10, fontweight="bold")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncol=2,
        frameon=False,
        fontsize=9,
        borderaxespad=0.1,
    )


def _band(runs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean over runs and half the width of its interval, shapes (scans,).

    Where fewer than two runs have a value the width is 0; where none has, the mean is NaN.
    """
    known = np.isfinite(runs)
    count = known.sum(axis=0)
    mean = np.where(known, runs, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    square = np.where(known, (runs - mean) ** 2, 0.0).sum(axis=0)
    several = np.maximum(count, 2)
    error = np.sqrt(square / (several - 1) / several)
    width = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, several - 1) * error
    return mean, np.where(count > 1, width, 0.0)


def _rows(result: Result, keys: Sequence[str], label: str) -> tuple[Figure, list[Axes]]:
    """Return rows of axes over time that share both scales."""
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 1.75 * len(keys)), dpi=DPI, layout="constrained")
    column = figure.subplots(len(keys), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes in column:
        plain_axes(axes)
        axes.set_ylabel(label)
    count = len(result.seeds)
    column[-1].set_xlabel(
        f"time from the first scan (s); {count} {'run' if count == 1 else 'runs'} of "
        f"“{result.variant.name}”"
    )
    span = max(float(result.scores.time_s[-1]), 1.0)
    column[-1].set_xlim(-0.01 * span, 1.01 * span)
    return figure, list(column)


def _from_zero(rows: Sequence[Axes]) -> None:
    """Let rows that share a scale begin at zero and hold all means; wide bands may leave it."""
    highest = max(float(np.max(line.get_ydata())) for axes in rows for line in axes.lines)
    rows[0].set_ylim(0.0, 1.15 * highest if highest > 0.0 else 1.0)
