"""A study's summary as tables, for the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from phd_jdtc_ros.evaluation.accumulator import NEES, OUTSIDE, Metric
from phd_jdtc_ros.evaluation.metric_table import GROUPS

from ..monte_carlo import ALL
from ..monte_carlo.definition import METRICS
from ..monte_carlo.kinds import TURNING_KINDS

# Metrics of cases with turning antennas.
SURVEYED = tuple(
    METRICS[key]
    for key in (
        "position_near",
        "position_rms",
        "median_error",
        "identity_switches",
        "false",
        "false_per_scan",
        "cpu_ms",
    )
)
# Metrics of the covariances, for trackers that state them. A few very small covariances make the
# NEES large, so that it is shown for all ages together only.
CONSISTENCY = (GROUPS[NEES][0], *GROUPS[OUTSIDE])
# Heading: number of filtered estimates farther than c from every target, per scan.
FALSE = "false at 0"


def tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield the tables of each case, and one of the goals.

    The first table of a case has the mean OSPA by variant and lag, or the surveillance metrics if
    antennas turn. The second has the consistency of the covariances, if any.
    """
    for case, variants in summary["cases"].items():
        if _turning(variants):
            yield _surveillance(case, variants)
            yield from _consistency(case, variants)
            continue
        lags = _all_lags(variants)
        table = Table(title=f"{escape(case)}: mean OSPA in m, by lag in scans")
        table.add_column("variant")
        table.add_column("runs", justify="right")
        for heading in (*lags, FALSE):
            table.add_column(heading, justify="right")
        for name, row in _ospa_rows(variants, lags, _number):
            table.add_row(escape(name), *row)
        yield table
        yield from _consistency(case, variants)
    goals = [goal for goal in summary["goals"] if goal["reached"] is not None]
    if goals:
        table = Table(title="goals")
        for heading in ("goal", "value", "bound", ""):
            table.add_column(heading)
        for goal in goals:
            table.add_row(*map(escape, _goal_row(goal)), style=None if goal["reached"] else "red")
        yield table


def markdown(summary: Mapping[str, Any]) -> str:
    """Return the same tables as `tables` in Markdown."""
    lines = []
    for case, variants in summary["cases"].items():
        if _turning(variants):
            lines += _surveillance_markdown(case, variants)
            lines += _consistency_markdown(variants)
            continue
        lags = _all_lags(variants)
        cutoff = summary.get("c_of_case", {}).get(case, summary["c"])
        distance = f"p = {summary['p']:g}, c = {cutoff:g} m"
        what = f"Mean OSPA ({distance}) in metres by lag in scans, 95 % interval."
        lines += [f"## {case}", "", what, ""]
        lines += _markdown_row(["variant", "runs", *lags, FALSE])
        lines += _markdown_row(["---", *["---:"] * (2 + len(lags))])
        for name, row in _ospa_rows(variants, lags, _with_interval):
            lines += _markdown_row([name, *row])
        lines.append("")
        lines += _consistency_markdown(variants)
    lines += ["## Goals", ""]
    lines += _markdown_row(["goal", "value", "bound", "reached"]) + _markdown_row(["---"] * 4)
    for goal in summary["goals"]:
        lines += _markdown_row(_goal_row(goal))
    return "\n".join(lines) + "\n"


def _turning(variants: Mapping[str, Any]) -> bool:
    """Return whether a case has turning antennas."""
    return any(found["kind"] in TURNING_KINDS for found in variants.values())


def _of_all(found: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Return a variant's lags, each with the figures of all targets."""
    return [(lag, sets[ALL]) for lag, sets in found["lags"].items()]


def _surveillance(case: str, variants: Mapping[str, Any]) -> Table:
    table = Table(title=f"{escape(case)}: targets that are scored, by lag in turns")
    table.add_column("variant")
    for heading in ("runs", "lag", *(metric.heading for metric in SURVEYED)):
        table.add_column(heading, justify="right")
    for name, *row in _figure_rows(variants, SURVEYED):
        table.add_row(escape(name), *row)
    return table


def _surveillance_markdown(case: str, variants: Mapping[str, Any]) -> list[str]:
    headings = ["variant", "runs", "lag", *(metric.heading for metric in SURVEYED)]
    lines = [f"## {case}", "", "Targets in the air, at the end of each turn; lags in turns.", ""]
    lines += _markdown_row(headings) + _markdown_row(["---", *["---:"] * (len(headings) - 1)])
    for row in _figure_rows(variants, SURVEYED):
        lines += _markdown_row(row)
    return [*lines, ""]


def _consistency(case: str, variants: Mapping[str, Any]) -> Iterator[Table]:
    """Yield the table of the covariances; none if no variant states covariances."""
    rows = _consistency_rows(variants)
    if rows:
        table = Table(title=f"{escape(case)}: covariances of positions, by lag in scans")
        table.add_column("variant")
        for heading in ("runs", "lag", *(metric.heading for metric in CONSISTENCY)):
            table.add_column(heading, justify="right")
        for name, *row in rows:
            table.add_row(escape(name), *row)
        yield table


def _consistency_markdown(variants: Mapping[str, Any]) -> list[str]:
    rows = _consistency_rows(variants)
    if not rows:
        return []
    headings = ["variant", "runs", "lag", *(metric.heading for metric in CONSISTENCY)]
    lines = ["Covariances of positions, by age of the track in scans; NEES / 2.", ""]
    lines += _markdown_row(headings) + _markdown_row(["---", *["---:"] * (len(headings) - 1)])
    for row in rows:
        lines += _markdown_row(row)
    return [*lines, ""]


def _consistency_rows(variants: Mapping[str, Any]) -> list[list[str]]:
    """Return the rows of the variants that state covariances."""
    return [row for row in _figure_rows(variants, CONSISTENCY) if any(c != "-" for c in row[3:])]


def _figure_rows(variants: Mapping[str, Any], columns: Sequence[Metric]) -> Iterator[list[str]]:
    """Yield each variant's name, number of runs, lag and mean figures."""
    for name, found in variants.items():
        for lag, figures in _of_all(found):
            means = [figures.get(metric.key) for metric in columns]
            cells = [
                "-" if mean is None else metric.text(mean["mean"])
                for metric, mean in zip(columns, means, strict=True)
            ]
            yield [name, str(found["runs"]), lag, *cells]


def _all_lags(variants: Mapping[str, Any]) -> list[str]:
    return sorted({lag for found in variants.values() for lag in found["lags"]}, key=int)


def _ospa_rows(
    variants: Mapping[str, Any], lags: Sequence[str], text: Callable[[Mapping[str, Any]], str]
) -> Iterator[tuple[str, list[str]]]:
    """Yield each variant's name, number of runs, mean OSPA at every lag, and false estimates."""
    for name, found in variants.items():
        means = [found["lags"][lag][ALL]["ospa"] if lag in found["lags"] else None for lag in lags]
        cells = ["-" if mean is None else text(mean) for mean in means]
        false = found["lags"].get("0", {}).get(ALL, {}).get("false_per_scan")
        cells.append("-" if false is None else f"{false['mean']:.3f}")
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
