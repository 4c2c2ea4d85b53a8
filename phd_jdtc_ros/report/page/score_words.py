# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A run's scores in the words, numbers and tables of the report's page, as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from phd_jdtc_ros.core.types import SMOOTHED, SOURCES

from ..score_columns import GOSPA, OSPA, OSPA2, SURVEILLANCE, Columns
from ..style import class_name

NO_VALUE = "\N{EN DASH}"  # what a table shows for no value

# The localisation part is shown once, OSPA's.
DISTANCES = (*OSPA, *(column for column in GOSPA if column[0] not in {name for name, _, _ in OSPA}))
WITH_OSPA2 = (*SURVEILLANCE, OSPA2)


def tables(summary: Mapping[str, Any]) -> str:
    """Return the figures of all sets, nothing if there are none."""
    if not _scored(summary):
        return ""
    gap = summary.get("long_gap_s")
    over = "" if gap is None else f"A gap of more than {gap:g} s is a long one."
    return "\n".join(
        (
            "<h2>Scores</h2>",
            _table(summary, DISTANCES, "Means over all scans."),
            "<details>\n<summary>Surveillance figures, classes taken for each other</summary>",
            _table(summary, WITH_OSPA2, over),
            _confusion(_score(summary, SMOOTHED, "all", "confusion")),
            "</details>",
        )
    )


def _table(summary: Mapping[str, Any], columns: Columns, note: str) -> str:
    """Return one table, without the columns that no set has a value for."""
    keys = _set_keys(summary)
    known = [
        column
        for column in columns
        if any(_score(summary, s, key, column[1]) is not None for s in SOURCES for key in keys)
    ]
    heads = "".join(f'<th scope="col">{escape(name)}</th>' for name, _, _ in known)
    rows = "\n".join(_rows(summary, known, key) for key in keys)
    return (
        '<div class="wide">\n<table>\n<thead><tr><th scope="col">set</th>'
        f'<th scope="col">source</th>{heads}</tr></thead>\n{rows}\n</table>\n</div>\n'
        f"<p>{escape(note)}</p>"
    )


def _confusion(matrix: Sequence[Sequence[int]] | None) -> str:
    """Return which class was taken for which, the last row false and the last column missed."""
    if matrix is None:
        return ""
    classes = len(matrix) - 1
    columns = [*(class_name(k) for k in range(classes)), "missed"]
    heads = "".join(f'<th scope="col">{name}</th>' for name in columns)
    rows = []
    for k, row in enumerate(matrix):
        name = "false" if k == classes else class_name(k)
        cells = [str(count) for count in row]
        if k == classes:
            cells[-1] = ""
        rows.append(
            f'<tr><th scope="row">{name}</th>' + "".join(f"<td>{c}</td>" for c in cells) + "</tr>"
        )
    return (
        '<div class="wide">\n<table class="narrow">\n<thead><tr><th scope="col">target</th>'
        f"{heads}</tr></thead>\n<tbody>\n"
        + "\n".join(rows)
        + "\n</tbody>\n</table>\n</div>\n<p>Targets of all scans by true class "
        "(rows) and smoothed class.</p>"
    )


def number(value: float | None, decimals: int = 0, unit: str = "") -> str:
    """Return `value` for a reader, a dash if it is None."""
    return NO_VALUE if value is None else f"{value:.{decimals}f}{unit}"


def percent(fraction: float | None, decimals: int = 0) -> str:
    """Return `fraction` in per cent, a dash if it is None."""
    return number(None if fraction is None else 100.0 * fraction, decimals, " %")


def _score(summary: Mapping[str, Any], source: str, key: str, part: str) -> Any:
    """Return one entry of the table; None where any level of it is missing."""
    value: Any = ((summary.get(source) or {}).get(key) or {}).get(part)
    return value


def _scored(summary: Mapping[str, Any]) -> list[str]:
    """Return the sources that there are scores of."""
    return [source for source in SOURCES if _score(summary, source, "all", "ospa") is not None]


def _set_keys(summary: Mapping[str, Any]) -> list[str]:
    """Return ``all`` and then the classes that any source has scores of."""
    found = {key for source in SOURCES for key in summary.get(source) or {}}
    return ["all", *sorted(found - {"all"}, key=lambda key: (len(key), key))]


def lead(summary: Mapping[str, Any]) -> str:
    """Return the result in one sentence, nothing if there is none."""
    means = [f"{number(_score(summary, s, 'all', 'ospa'))} m {s}" for s in _scored(summary)]
    if not means:
        return ""
    reduction = summary.get("reduction")
    change = "" if reduction is None else f", {_change(reduction)}"
    return f'<p class="lead">Mean OSPA distance of all targets: {", ".join(means)}{change}.</p>'


def _change(reduction: float) -> str:
    word = "less" if reduction >= 0.0 else "more"
    return f"{percent(abs(reduction))} {word}"


def tiles(summary: Mapping[str, Any]) -> str:
    """Return the headline numbers that are known, each with its name."""
    step_ms = summary.get("step_ms") or {}
    numbers = [
        ("OSPA reduction", percent(summary.get("reduction"))),
        ("smoothed OSPA", number(_score(summary, SMOOTHED, "all", "ospa"), 1, " m")),
        ("class accuracy", percent(summary.get("class_accuracy"), 1)),
        ("step time, median", number(step_ms.get("median"), 1, " ms")),
        ("step time, 99 %", number(step_ms.get("p99"), 1, " ms")),
        ("scans scored", number(summary.get("scans") or None)),
    ]
    return "\n".join(
        f"<div><dt>{name}</dt><dd>{value}</dd></div>"
        for name, value in numbers
        if value != NO_VALUE
    )


def _rows(summary: Mapping[str, Any], columns: Columns, key: str) -> str:
    """Return one set's rows, the filter's above the smoother's."""
    name = "all classes" if key == "all" else key.replace("_", " ")
    rows = []
    for source in _scored(summary):
        values = [(_score(summary, source, key, part), text) for _, part, text in columns]
        cells = "".join(f"<td>{NO_VALUE if v is None else t.format(v)}</td>" for v, t in values)
        rows.append(
            f'<tr class="{source}"><th scope="row">{escape(name)}</th><th>{source}</th>{cells}</tr>'
        )
        name = ""
    return "<tbody>\n" + "\n".join(rows) + "\n</tbody>"


def definitions(summary: Mapping[str, Any]) -> str:
    """Return what the words mean, nothing if there are no scores to mean anything."""
    if not _scored(summary):
        return ""
    terms = "\n".join(f"<dt>{term}</dt>\n<dd>{text}</dd>" for term, text in _terms(summary))
    return f'<h2>Definitions</h2>\n<dl class="terms">\n{terms}\n</dl>'


def _terms(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the words and what they mean, as HTML."""
    order, cutoff = summary.get("p"), summary.get("c")
    p = NO_VALUE if order is None else f"{order:g}"
    c = NO_VALUE if cutoff is None else f"{cutoff:g}"
    return [
        (
            f"OSPA (p = {p}, c = {c} m)",
            "Optimal sub-pattern assignment distance between the estimated and the true positions "
            "of one scan. Estimates and targets are paired so that the sum of the p-th powers of "
            "their distances, each cut off at c, is least; a missing or false target counts as a "
            "distance of c; the mean of these powers over the larger set, to the power 1/p, is "
            f"the OSPA distance. Here p = {p} and c = {c} m. It is 0 if both sets are empty and c "
            "if only one is.",
        ),
        (
            "Localisation, cardinality",
            "The two parts of the OSPA distance: paired positions, and the wrong number of "
            "targets. Their p-th powers add up to that of the distance in every scan; the parts "
            "themselves add only for p = 1.",
        ),
        (
            "Number error",
            "Mean over the scans of the absolute difference between the number of estimates and "
            "the number of targets.",
        ),
        (
            "GOSPA, missed, false",
            "Generalised OSPA distance (alpha = 2) with the same p and c: it is not divided by the "
            "number of targets, and every missed and every false target costs c/2<sup>1/p</sup>. "
            "Missed and false are the mean numbers of these a scan.",
        ),
        (
            "Position RMS, position detected, gaps",
            "Targets are paired with estimates by position alone, closer than c: the root mean "
            "square of the paired distances, and the share of targets with a pair. A gap is a time "
            "that a living target goes without one.",
        ),
        (
            "Set",
            "<em>All classes</em> compares positions whatever their class. <em>Class k</em> "
            "compares the estimates of class k with the targets of class k, so a wrong class "
            "counts twice: missing in one, false in the other.",
        ),
        (
            "OSPA reduction",
            "1 &minus; mean smoothed OSPA / mean filtered OSPA, of all classes.",
        ),
        (
            "Class accuracy",
            "Smoothed estimates are paired with targets by position alone, closer than c; the "
            "class accuracy is the fraction of these pairs with the right class. Missed and false "
            "targets do not enter it.",
        ),
        (
            "Filtered, smoothed",
            "A filtered estimate uses the scans up to its own time, a smoothed one also the scans "
            "that followed within the lag. The last scans of a run are smoothed with those that "
            "were left.",
        ),
        (
            "Step time",
            "CPU time from the receipt of a scan to the publication of its estimates.",
        ),
    ]
