"""The scores of a run, as values for `metrics.json` and as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES
from phd_jdtc_ros.evaluation.accumulator import (
    CLASSES,
    GOSPA,
    NEES,
    OSPA,
    SURVEILLANCE,
    TRACKS,
    Metric,
)
from phd_jdtc_ros.evaluation.run_scores import BY_KEY, GLOBAL_METRICS, GROUPS, Evaluation, reduction

from .record import Sets

Columns = Sequence[Metric]


def metrics(
    evaluation: Evaluation, step_ms: FloatArray, engine: str | None = None
) -> dict[str, Any]:
    """Return a run's summary with its step times, in the form of `metrics.json`.

    `step_ms`, (scans,), has the CPU time of each step, milliseconds; it is empty if not measured.
    """
    summary = evaluation.summary()
    if engine is not None:
        summary["engine"] = engine
    if len(step_ms):
        summary["step_ms"] = {
            "median": float(np.median(step_ms)),
            "p99": float(np.percentile(step_ms, 99)),
        }
    return summary


def unscored_note(summary: Mapping[str, Any]) -> str:
    """Return a sentence about the unscored targets; empty if there are none."""
    number, speed = summary.get("slow_targets"), summary.get("least_speed")
    if not number:
        return ""
    return (
        f"Targets slower than {speed:g} m/s are not scored, {number:.1f} on average: this tracker "
        "takes them for clutter, see clutter_map_speed."
    )


def score_tables(summary: dict[str, Any]) -> Group:
    """Return the figures of filter and smoother, for all targets and for each class, as tables.

    The tables are OSPA, GOSPA, the surveillance figures, the consistency of the covariances if
    there are any, and the confusion matrix if there are several classes. `summary` is the result
    of `metrics`.
    """
    distance = f"p = {summary['p']:g}, c = {summary['c']:g} m"
    gaps = f"long gaps: over {summary['long_gap_s']:g} s between estimates\n{_of_tracks(summary)}"
    title = f"means over {_scans(summary)} scans (OSPA: {distance})"
    tables = [_table(GROUPS[OSPA], summary, title, _headline(summary), reduced=True)]
    # These tables are shown even without any value.
    titles = {
        GOSPA: f"means over the scans (GOSPA: {distance})",
        SURVEILLANCE: SURVEILLANCE.title,
    }
    captions = {SURVEILLANCE: gaps, NEES: _bands(summary)}
    tables += [
        _table(metrics, summary, titles.get(group, group.title), captions.get(group))
        for group, metrics in GROUPS.items()
        if group.of_sets and group != OSPA and (group in titles or _any_known(metrics, summary))
    ]
    sets, matrix = Sets.of_summary(summary), summary[SMOOTHED]["all"]["confusion"]
    if matrix is not None and not sets.one_class:
        tables.append(_confusion(matrix, sets))
    if compared := summary.get("compared"):
        tables.append(_engines(summary, compared))
    words = filter(None, [unscored_note(summary)])
    return Group(*[part for table in tables for part in ("", table)][1:], *words)


def _engines(summary: dict[str, Any], compared: list[dict[str, Any]]) -> Table:
    """Return a table of the engines: the paper's offline, and the live one."""
    headings = ("engine", "filter", "smoother", "reduction", "right\nclass", "CPU per\nscan")
    title = "the paper's filter on these detections: OSPA of all targets"
    return simple_table(title, headings, engine_rows(summary, compared))


def simple_table(
    title: str,
    headings: Sequence[str],
    rows: Iterable[Sequence[str]] = (),
    caption: str | None = None,
) -> Table:
    """Return a table of plain texts, the first column aligned left and the others right."""
    table = Table(title=escape(title), caption=caption and escape(caption))
    for index, heading in enumerate(headings):
        table.add_column(escape(heading), justify="right" if index else "left")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def engine_rows(summary: dict[str, Any], compared: list[dict[str, Any]]) -> list[list[str]]:
    """Return rows of engine, filtered and smoothed OSPA, reduction, class accuracy and CPU time."""
    rows = []
    for found, how in (*((each, "offline") for each in compared), (summary, "live")):
        cpu_ms = found.get("step_ms", {}).get("median")
        before, after = (found[source]["all"] for source in (FILTERED, SMOOTHED))
        accuracy = found["class_accuracy"]
        rows.append(
            [
                f"{found['engine']}, {how}",
                _cell(BY_KEY["ospa"], before),
                _cell(BY_KEY["ospa"], after),
                _reduction(before["ospa"], after["ospa"]),
                "-" if accuracy is None else BY_KEY["class_accuracy"].text(accuracy),
                "-" if cpu_ms is None else f"{cpu_ms:.1f} ms",
            ]
        )
    return rows


def _scans(summary: dict[str, Any]) -> str:
    """Return the number of scored scans, with the total if it is known and larger."""
    scored, known = summary["scans"], summary["truth_scans"]
    return str(scored) if known in (None, scored) else f"{scored} of {known}"


def _table(
    columns: Columns,
    summary: dict[str, Any],
    title: str,
    caption: str | None,
    reduced: bool = False,
) -> Table:
    """Return a table of both sources; if `reduced`, with the reduction by smoothing."""
    table, sets = Table(title=title, caption=caption), Sets.of_summary(summary)
    table.add_column("targets", no_wrap=True)
    table.add_column("source", no_wrap=True)
    for metric in columns:
        table.add_column(metric.heading.replace(" ", "\n", 1), justify="right", no_wrap=True)
    for key in sets.keys:
        before, after = summary[FILTERED][key], summary[SMOOTHED][key]
        name = escape(sets.title(key, everything="all"))
        table.add_row(name, "filter", *_cells(columns, before))
        table.add_row("", "smoother", *_cells(columns, after), end_section=not reduced)
        if reduced:
            change = [_reduction(before[metric.key], after[metric.key]) for metric in columns]
            table.add_row("", "reduction", *change, style="bold", end_section=True)
    return table


def _any_known(columns: Columns, summary: dict[str, Any]) -> bool:
    return any(
        figures.get(metric.key) is not None
        for source in (FILTERED, SMOOTHED)
        for figures in summary[source].values()
        for metric in columns
    )


def nees_bands(summary: Mapping[str, Any]) -> Iterator[tuple[str, int, str]]:
    """Yield source, number of pairs and 95 % band of the NEES; nothing without covariances."""
    for source in SOURCES:
        found = (summary.get("consistency") or {}).get(source) or {}
        if found.get("pairs"):
            low, high = found["nees_band_95"]
            yield source, found["pairs"], f"{low:.2f} to {high:.2f}"


def _bands(summary: dict[str, Any]) -> str:
    names = {FILTERED: "filter", SMOOTHED: "smoother"}
    return "\n".join(
        f"95 % band of {pairs} pairs, {names[source]}: {band}"
        for source, pairs, band in nees_bands(summary)
    )


def _of_tracks(summary: dict[str, Any]) -> str:
    """Return the figures that exist for all targets only, one line each."""
    sources = [summary[source]["all"] for source in (FILTERED, SMOOTHED)]
    known = [
        metric
        for metric in GLOBAL_METRICS
        if metric.group != CLASSES and any(each.get(metric.key) is not None for each in sources)
    ]
    lines = [
        "{}: filter {}, smoother {}".format(m.heading, *(_cell(m, each) for each in sources))
        for m in known
    ]
    if not any(metric in known for metric in GROUPS[TRACKS]):
        lines.append("no OSPA(2) and no identity switches: the estimates carry no track ids")
    return "\n".join(lines)


def confusion_rows(
    matrix: Sequence[Sequence[int]], sets: Sets, false: str
) -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the confusion matrix.

    The last column has missed targets, and the last row, with the title `false`, false estimates.
    """
    titles = [sets.class_title(k) for k in range(len(matrix) - 1)]
    rows = [
        [title, *map(str, counts)] for title, counts in zip([*titles, false], matrix, strict=True)
    ]
    rows[-1][-1] = ""
    return ["target", *titles, "missed"], rows


def _confusion(matrix: Sequence[Sequence[int]], sets: Sets) -> Table:
    """Return the smoother's confusion matrix, counts over the run."""
    title = "smoother: true against estimated class"
    return simple_table(title, *confusion_rows(matrix, sets, "none (false)"))


def _cells(columns: Columns, figures: dict[str, Any]) -> list[str]:
    return [_cell(metric, figures) for metric in columns]


def _cell(metric: Metric, figures: dict[str, Any]) -> str:
    value = figures.get(metric.key)
    return "-" if value is None else metric.text(value)


def _reduction(before: float | None, after: float | None) -> str:
    change = reduction(before, after)
    return "-" if change is None else f"{change:.0%}"


def _headline(summary: dict[str, Any]) -> str:
    parts, times = [], []
    if summary.get("engine"):
        parts.append(f"engine: {summary['engine']}")
    if summary["class_accuracy"] is not None and not Sets.of_summary(summary).one_class:
        parts.append(f"right class: {BY_KEY['class_accuracy'].text(summary['class_accuracy'])}")
    if "step_ms" in summary:
        step = summary["step_ms"]
        times = [f"CPU per scan: median {step['median']:.1f} ms, p99 {step['p99']:.1f} ms"]
    return "\n".join(filter(None, ("; ".join(parts), *times)))
