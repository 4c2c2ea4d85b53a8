"""The pictures and tables of a Monte Carlo study: pure functions from its results.

Figures over time are of the first variant of this package's tracker: means over runs, with bands
of their 95 % confidence intervals. Colours, lines and markers are those of a single run's pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter
from rich.markup import escape
from rich.table import Table
from scipy import special

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.evaluation.accumulator import NEES, OUTSIDE, Metric
from phd_jdtc_ros.evaluation.comparison import ALL
from phd_jdtc_ros.evaluation.run_scores import GROUPS
from phd_jdtc_ros.report import style
from phd_jdtc_ros.report.style import COLOURS, DPI, GREY, INK, WIDTH_IN
from phd_jdtc_ros.report.table import simple_table

from .definition import KINDS, METRICS
from .results import Mean, Result
from .tasks import slug


def ospa_against_lag(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of all targets against the lag, one line per variant."""
    figure = Figure(figsize=(WIDTH_IN, 5.2), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    style.plain_axes(axes)
    styles, highest = _styles(results), 0.0
    for result in results:
        lags = result.scores.lags
        means = [Mean.of(result.figure("ospa", lag)) for lag in lags]
        highest = max(highest, *(mean.mean for mean in means))
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
    # From zero to above all means; error bars of few runs may exceed it.
    axes.set_ylim(0.0, 1.15 * highest or 1.0)
    axes.set_xticks(sorted({lag for result in results for lag in result.scores.lags}))
    figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    return figure


def _styles(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Return the style of each variant; known association has styles of its own."""
    styles: dict[str, dict[str, Any]] = {}
    contenders = [result.variant for result in results if not result.variant.kind.known_association]
    for index, variant in enumerate(contenders):
        styles[variant.name] = {
            "color": COLOURS[index % len(COLOURS)],
            # The markers are shifted each time the colours start again.
            "marker": style.MARKERS[(index + index // len(COLOURS)) % len(style.MARKERS)],
            "linestyle": style.LINES[index // len(COLOURS) % len(style.LINES)],
            "linewidth": 2.2 if index == 0 else 1.4,
            "markersize": 5.5,
        }
    for result in results:
        if result.variant.kind.known_association:
            dashes = (5, 3) if result.variant.kind.name == "reference" else (1, 2)
            styles[result.variant.name] = {"color": INK, "linestyle": (0, dashes), "linewidth": 1.4}
    return styles


def rows_over_time(result: Result, keys: Sequence[str], label: str) -> tuple[Figure, list[Axes]]:
    """Return rows of axes over time that share both scales."""
    runs = f"{len(result.seeds)} {'run' if len(result.seeds) == 1 else 'runs'}"
    text = f"time from the first scan (s); {runs} of “{result.variant.name}”"
    return style.rows_over_time(len(keys), label, text, max(float(result.scores.time_s[-1]), 1.0))


def draw_lags(
    axes: Axes, result: Result, key: str, name: str, number: str, title: str | None = None
) -> None:
    """Draw a metric of filter and smoother over time, with its band and its overall mean.

    `key` is the set, which determines the colour and the usual title, and `number` the mean's
    format.
    """
    colour = INK if key == ALL else style.class_colour(int(key.removeprefix("class_")))
    time_s = result.scores.time_s
    for lag, label in _shown_lags(result):
        mean, half_width = band(result.over_time(name, lag, key))
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
    style.row_header(axes, title or default)


def _shown_lags(result: Result) -> list[tuple[int, str]]:
    lags = result.scores.lags
    # The lag drawn over time, or the largest smaller one of the study.
    shown_lag = 5
    later = [lag for lag in lags if 0 < lag <= shown_lag] or [lag for lag in lags if lag > 0]
    names = [(0, "filter")] if 0 in lags else []
    return names + ([(max(later), f"smoother, lag {max(later)}")] if later else [])


def band(runs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean over runs and half the width of its confidence interval, shapes (scans,).

    With fewer than two values the width is 0; without any the mean is NaN.
    """
    known = np.isfinite(runs)
    count = known.sum(axis=0)
    mean = np.where(known, runs, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan)
    square = np.where(known, (runs - mean) ** 2, 0.0).sum(axis=0)
    several = np.maximum(count, 2)
    error = np.sqrt(square / (several - 1) / several)
    confidence = 0.95
    width = special.stdtrit(several - 1, 0.5 + 0.5 * confidence) * error
    return mean, np.where(count > 1, width, 0.0)


def scale_from_zero(rows: Sequence[Axes]) -> None:
    """Scale rows that share an axis from zero to above all means; wide bands may exceed it."""
    for axes in rows:
        axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))
    highest = max(float(np.max(line.get_ydata())) for axes in rows for line in axes.lines)
    rows[0].set_ylim(0.0, 1.15 * highest if highest > 0.0 else 1.0)


def ospa_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean OSPA of filter and smoother, one row per class and one for all targets."""
    return _from_zero(results, "OSPA (m)", "ospa", "{:.0f} m")


def number_error_over_time(results: Sequence[Result]) -> Figure:
    """Draw the mean of |n_est - n_true|, one row per class and one for all targets."""
    return _from_zero(results, "|number error|", "cardinality_abs_error", "{:.3f}")


def parts_over_time(results: Sequence[Result]) -> Figure:
    """Draw the localisation part and the cardinality part of all targets' mean OSPA."""
    titles = {
        "localization": "all classes: localisation part",
        "cardinality": "all classes: cardinality part",
    }
    main = _main(results)
    figure, rows = rows_over_time(main, list(titles), "part of OSPA (m)")
    for axes, (name, title) in zip(rows, titles.items(), strict=True):
        draw_lags(axes, main, ALL, name, "{:.0f} m", title)
    scale_from_zero(rows)
    return figure


def class_accuracy_over_time(results: Sequence[Result]) -> Figure:
    """Draw the share of matched targets with the right class, by class and for all targets."""
    figure, rows = _by_set(results, "right class", "class_accuracy", "{:.2%}")
    for axes in rows:
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    lowest = np.nanmin([np.nan_to_num(line.get_ydata(), nan=1.0) for a in rows for line in a.lines])
    span = max(1.3 * (1.0 - lowest), 0.02)
    rows[0].set_ylim(1.0 - span, 1.0 + 0.05 * span)
    return figure


def _by_set(
    results: Sequence[Result], label: str, metric: str, number: str
) -> tuple[Figure, list[Axes]]:
    """Draw a metric over time, one row per class and one for all targets."""
    main = _main(results)
    keys = [*(key for key in main.scores.sets if key != ALL), ALL]
    figure, rows = rows_over_time(main, keys, label)
    for axes, key in zip(rows, keys, strict=True):
        draw_lags(axes, main, key, metric, number)
    return figure, rows


def _from_zero(results: Sequence[Result], label: str, metric: str, number: str) -> Figure:
    figure, rows = _by_set(results, label, metric, number)
    scale_from_zero(rows)
    return figure


def has_main(results: Sequence[Result]) -> bool:
    """Return whether a study has a variant of this package's tracker."""
    return any(result.variant.kind.is_engine for result in results)


def _main(results: Sequence[Result]) -> Result:
    """Return the study's first variant of this package's tracker."""
    return next(result for result in results if result.variant.kind.is_engine)


class Chart(NamedTuple):
    """One kind of picture of a case."""

    name: str  # Name of the file, without suffix
    has_data: Callable[[Sequence[Result]], bool]
    draw: Callable[[Sequence[Result]], Figure]


CHARTS = (
    Chart("ospa_against_lag", bool, ospa_against_lag),
    Chart("ospa_over_time", has_main, ospa_over_time),
    Chart("parts_over_time", has_main, parts_over_time),
    Chart("number_error_over_time", has_main, number_error_over_time),
    Chart("class_accuracy_over_time", has_main, class_accuracy_over_time),
)


def write_all(results: Sequence[Result], directory: Path) -> list[Path]:
    """Write every picture of a study as a PNG, 1200 pixels wide, with one directory per case.

    Directories are created if necessary; the paths are returned case by case.
    """
    pictures = []
    for case in dict.fromkeys(result.case for result in results):
        here = [result for result in results if result.case == case]
        for chart in CHARTS:
            if chart.has_data(here):
                path = directory / slug(case) / f"{chart.name}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                style.save(chart.draw(here), path)
                pictures.append(path)
    return pictures


# Metrics of cases with turning antennas.
SURVEYED = tuple(
    METRICS[key]
    for key in (
        *("position_near", "position_rms", "median_error"),
        *("identity_switches", "false", "false_per_scan", "cpu_ms"),
    )
)
# Metrics of the covariances, for trackers that state them. A few very small covariances make the
# NEES large, so that it is shown for all ages together only.
CONSISTENCY = (GROUPS[NEES][0], *GROUPS[OUTSIDE])
# Heading: number of filtered estimates farther than c from every target, per scan.
FALSE = "false at 0"


class Sheet(NamedTuple):
    """A table of a case."""

    title: str  # Title in the terminal
    text: str  # Sentence above the table in Markdown
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield the tables of each case, and one of the goals.

    The first table of a case has the mean OSPA by variant and lag, or the surveillance metrics if
    antennas turn. The second has the consistency of the covariances, if any.
    """
    for case, sheets in _sheets(summary, _number):
        for sheet in sheets:
            yield simple_table(f"{case}: {sheet.title}", sheet.headings, sheet.rows)
    goals = [goal for goal in summary["goals"] if goal["reached"] is not None]
    if goals:
        table = Table("goal", "value", "bound", "", title="goals")
        for goal in goals:
            table.add_row(*map(escape, _goal_row(goal)), style=None if goal["reached"] else "red")
        yield table


def markdown(summary: Mapping[str, Any]) -> str:
    """Return the same tables as `tables` in Markdown, with intervals."""
    lines = []
    for case, sheets in _sheets(summary, _with_interval):
        lines += [f"## {case}", ""]
        for sheet in sheets:
            rule = ["---", *["---:"] * (len(sheet.headings) - 1)]
            lines += [sheet.text, "", *map(_markdown_row, (sheet.headings, rule, *sheet.rows)), ""]
    rows = (["goal", "value", "bound", "reached"], ["---"] * 4, *map(_goal_row, summary["goals"]))
    return "\n".join([*lines, "## Goals", "", *map(_markdown_row, rows)]) + "\n"


def _sheets(
    summary: Mapping[str, Any], text: Callable[[Mapping[str, Any]], str]
) -> Iterator[tuple[str, list[Sheet]]]:
    """Yield each case with its tables; `text` formats a mean."""
    for case, variants in summary["cases"].items():
        if any(KINDS[found["kind"]].turning for found in variants.values()):
            first = Sheet(
                "targets that are scored, by lag in revolutions",
                "Targets in the air, at the end of each revolution; lags in revolutions.",
                ["variant", "runs", "lag", *(metric.heading for metric in SURVEYED)],
                list(_figure_rows(variants, SURVEYED)),
            )
        else:
            lags = sorted({lag for found in variants.values() for lag in found["lags"]}, key=int)
            cutoff = summary.get("c_of_case", {}).get(case, summary["c"])
            distance = f"p = {summary['p']:g}, c = {cutoff:g} m"
            first = Sheet(
                "mean OSPA in m, by lag in scans",
                f"Mean OSPA ({distance}) in metres by lag in scans, 95 % interval.",
                ["variant", "runs", *lags, FALSE],
                list(_ospa_rows(variants, lags, text)),
            )
        consistency = Sheet(
            "covariances of positions, by lag in scans",
            "Covariances of positions, by age of the track in scans; NEES / 2.",
            ["variant", "runs", "lag", *(metric.heading for metric in CONSISTENCY)],
            [row for row in _figure_rows(variants, CONSISTENCY) if {*row[3:]} != {"-"}],
        )
        yield case, [first, *([consistency] if consistency.rows else [])]


def _figure_rows(variants: Mapping[str, Any], columns: Sequence[Metric]) -> Iterator[list[str]]:
    """Yield each variant's name, number of runs, lag and mean figures."""
    for name, found in variants.items():
        for lag, sets in found["lags"].items():
            means = [sets[ALL].get(metric.key) for metric in columns]
            cells = [
                "-" if mean is None else metric.text(mean["mean"])
                for metric, mean in zip(columns, means, strict=True)
            ]
            yield [name, str(found["runs"]), lag, *cells]


def _ospa_rows(
    variants: Mapping[str, Any], lags: Sequence[str], text: Callable[[Mapping[str, Any]], str]
) -> Iterator[list[str]]:
    """Yield each variant's name, number of runs, mean OSPA at every lag, and false estimates."""
    for name, found in variants.items():
        means = [found["lags"][lag][ALL]["ospa"] if lag in found["lags"] else None for lag in lags]
        cells = ["-" if mean is None else text(mean) for mean in means]
        false = found["lags"].get("0", {}).get(ALL, {}).get("false_per_scan")
        cells.append("-" if false is None else f"{false['mean']:.3f}")
        yield [name, str(found["runs"]), *cells]


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


def _markdown_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
