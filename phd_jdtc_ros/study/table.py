"""The scores of a run as numbers for a file and as a table for the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from phd_jdtc_ros.core.evaluation import FILTERED, SMOOTHED, Evaluation
from phd_jdtc_ros.core.types import FloatArray

_COLUMNS = ("ospa", "localization", "cardinality", "cardinality_abs_error")


def metrics(evaluation: Evaluation, step_ms: FloatArray) -> dict[str, Any]:
    """Return a run's summary with its step times, as `metrics.json` holds it.

    Parameters
    ----------
    evaluation : Evaluation
    step_ms : array of shape (scans,)
        CPU time of each step; empty where it was not measured.
    """
    summary = evaluation.summary()
    if len(step_ms):
        summary["step_ms"] = {
            "median": float(np.median(step_ms)),
            "p99": float(np.percentile(step_ms, 99)),
        }
    return summary


def ospa_table(summary: dict[str, Any]) -> Table:
    """Return the means of filter and smoother, for all targets and for each class.

    Parameters
    ----------
    summary : dict
        Of `metrics`.
    """
    table = Table(
        title=f"means over {summary['scans']} scans "
        f"(OSPA: p = {summary['p']:g}, c = {summary['c']:g} m)",
        caption=_headline(summary),
    )
    table.add_column("targets")
    table.add_column("source")
    for heading in ("OSPA", "localisation", "cardinality", "number error"):
        table.add_column(heading, justify="right")
    for key, before in summary[FILTERED].items():
        after = summary[SMOOTHED][key]
        table.add_row(key.replace("_", " "), "filter", *map(_figure, _COLUMNS, _values(before)))
        table.add_row("", "smoother", *map(_figure, _COLUMNS, _values(after)))
        change = map(_reduction, _values(before), _values(after))
        table.add_row("", "reduction", *change, style="bold", end_section=True)
    return table


def _values(means: dict[str, float | None]) -> list[float | None]:
    return [means[column] for column in _COLUMNS]


def _figure(column: str, value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if column == "cardinality_abs_error" else f"{value:.1f} m"


def _reduction(before: float | None, after: float | None) -> str:
    return "-" if not before or after is None else f"{1.0 - after / before:.0%}"


def _headline(summary: dict[str, Any]) -> str:
    parts = []
    if summary["class_accuracy"] is not None:
        parts.append(f"right class: {summary['class_accuracy']:.1%}")
    if "step_ms" in summary:
        step = summary["step_ms"]
        parts.append(f"CPU a scan: median {step['median']:.1f} ms, p99 {step['p99']:.1f} ms")
    return "; ".join(parts)
