"""A study's summary as tables, for the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from phd_jdtc_ros.evaluation.accumulator import NEES, OUTSIDE, Metric
from phd_jdtc_ros.evaluation.metric_table import GROUPS
from phd_jdtc_ros.report.table import simple_table

from ..monte_carlo import ALL
from ..monte_carlo.definition import METRICS
from ..monte_carlo.kinds import KINDS

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
