"""A run's report: one HTML page that needs nothing but itself.

The pictures are inlined and the style sheet is part of the page, so the file can be mailed, kept
with the data and opened from disk years later, in light and in dark.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from phd_jdtc_ros.core.evaluation import FILTERED, SMOOTHED, SOURCES

NO_VALUE = "\N{EN DASH}"  # what a table shows for no value

# Heading, key in a set's scores, decimals.
COLUMNS = (
    ("OSPA (m)", "ospa", 1),
    ("localisation (m)", "localization", 1),
    ("cardinality (m)", "cardinality", 1),
    ("cardinality error (targets)", "cardinality_abs_error", 3),
)

STYLE = """
:root { color-scheme: light dark; --ink: #1c2126; --soft: #59636e; --page: #ffffff;
  --card: #f4f6f8; --rule: #d5dbe1; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ec; --soft: #9aa5b1; --page: #14181c;
  --card: #1f252b; --rule: #38414a; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 60rem; padding: 2rem 1.25rem 4rem; background: var(--page);
  color: var(--ink); font: 1rem/1.5 system-ui, "Segoe UI", "Liberation Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .5rem; }
h2 { font-size: 1.2rem; margin: 2.5rem 0 .75rem; }
p { margin: .5rem 0; }
.lead { color: var(--soft); font-size: 1.1rem; margin-bottom: 1.5rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(14rem, 1fr)); gap: .75rem;
  margin: 0; }
.tiles div { background: var(--card); border-radius: .5rem; padding: .75rem 1rem; }
.tiles dt { color: var(--soft); font-size: .85rem; }
.tiles dd { margin: 0; font-size: 1.5rem; font-weight: 600; white-space: nowrap; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .75rem; text-align: right; }
th:nth-child(-n+2) { text-align: left; font-weight: 400; }
thead th, thead th:nth-child(-n+2) { color: var(--soft); font-size: .85rem; font-weight: 600;
  vertical-align: bottom; }
tbody { border-top: 1px solid var(--rule); }
tbody:last-child { border-bottom: 1px solid var(--rule); }
tr.smoothed > * { font-weight: 600 !important; }
figure { margin: 0 0 2.5rem; }
figure h3 { font-size: 1.05rem; margin: 0 0 .25rem; }
figcaption p { color: var(--soft); max-width: 46rem; margin: 0 0 .75rem; }
figure img { display: block; width: 100%; height: auto; background: #ffffff; padding: .5rem;
  border: 1px solid var(--rule); border-radius: .5rem; }
.terms dt { font-weight: 600; margin-top: .75rem; }
.terms dd { margin: 0; max-width: 46rem; }
@media print { body { max-width: none; padding: 0; } figure { break-inside: avoid; } }
"""

PAGE = Template(
    """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>$style</style>
</head>
<body>
<header>
<h1>$title</h1>
<p class="lead">$lead</p>
</header>
<main>
<dl class="tiles">
$tiles
</dl>
<h2>Filter against smoother</h2>
<div class="wide">
<table>
<thead><tr><th scope="col">source</th><th scope="col">set</th>$headings</tr></thead>
$rows
</table>
</div>
<p>Means over all scans; lower is better in every column.</p>
$figures
<h2>Definitions</h2>
<dl class="terms">
$terms
</dl>
</main>
</body>
</html>
"""
)


def write_report(
    path: Path, title: str, summary: Mapping[str, Any], figures: Sequence[tuple[str, str, Path]]
) -> Path:
    """Write the report of a run.

    Parameters
    ----------
    path : pathlib.Path
        Of the page; its directory is made if it does not exist.
    title : str
    summary : mapping
        As `Evaluation.summary` returns it, with an optional ``step_ms`` of ``median`` and
        ``p99``. A value that is missing or None is shown as a dash.
    figures : sequence of (title, caption, path of a PNG)
        In order; `figures.Picture` is one.

    Returns
    -------
    pathlib.Path
        `path`.
    """
    page = PAGE.substitute(
        title=escape(title),
        style=STYLE,
        lead=escape(_lead(summary)),
        tiles="\n".join(_entry(*tile) for tile in _tiles(summary)),
        headings="".join(f'<th scope="col">{escape(name)}</th>' for name, _, _ in COLUMNS),
        rows="\n".join(_rows(summary, key) for key in _set_keys(summary)),
        figures=_figures(figures),
        terms="\n".join(f"<dt>{t}</dt>\n<dd>{d}</dd>" for t, d in _terms(summary)),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")
    return path


def number(value: float | None, decimals: int = 0, unit: str = "") -> str:
    """Return `value` for a reader, a dash if it is None."""
    return NO_VALUE if value is None else f"{value:.{decimals}f}{unit}"


def percent(fraction: float | None, decimals: int = 0) -> str:
    """Return `fraction` in per cent, a dash if it is None."""
    return number(None if fraction is None else 100.0 * fraction, decimals, " %")


def _score(summary: Mapping[str, Any], source: str, key: str, part: str) -> float | None:
    """Return one entry of the table; None where any level of it is missing."""
    value: float | None = ((summary.get(source) or {}).get(key) or {}).get(part)
    return value


def _set_keys(summary: Mapping[str, Any]) -> list[str]:
    """Return ``all`` and then the classes that any source has scores of."""
    found = {key for source in SOURCES for key in summary.get(source) or {}}
    return ["all", *sorted(found - {"all"}, key=lambda key: (len(key), key))]


def _lead(summary: Mapping[str, Any]) -> str:
    """Return the result in one sentence."""
    before, after = (_score(summary, source, "all", "ospa") for source in SOURCES)
    if before is None or after is None:
        return "No scan has both a true state and an estimate, so there are no scores."
    reduction = summary.get("reduction")
    change = "" if reduction is None else f", {_change(reduction)}"
    return (
        f"Mean OSPA distance of all targets: {number(before)} m filtered, "
        f"{number(after)} m smoothed{change}."
    )


def _change(reduction: float) -> str:
    word = "less" if reduction >= 0.0 else "more"
    return f"{percent(abs(reduction))} {word}"


def _tiles(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the headline numbers, each with its name."""
    step_ms = summary.get("step_ms") or {}
    return [
        ("OSPA reduction by smoothing", percent(summary.get("reduction"))),
        ("smoothed OSPA, all targets", number(_score(summary, SMOOTHED, "all", "ospa"), 1, " m")),
        ("class accuracy", percent(summary.get("class_accuracy"), 1)),
        ("step time, median", number(step_ms.get("median"), 1, " ms")),
        ("step time, 99th percentile", number(step_ms.get("p99"), 1, " ms")),
        ("scans", number(summary.get("scans"))),
    ]


def _entry(name: str, value: str) -> str:
    return f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"


def _rows(summary: Mapping[str, Any], key: str) -> str:
    """Return one set's rows, the filter's above the smoother's."""
    name = "all classes" if key == "all" else key.replace("_", " ")
    rows = []
    for source in (FILTERED, SMOOTHED):
        cells = "".join(
            f"<td>{number(_score(summary, source, key, part), decimals)}</td>"
            for _, part, decimals in COLUMNS
        )
        rows.append(
            f'<tr class="{source}"><th>{source}</th><th scope="row">{escape(name)}</th>{cells}</tr>'
        )
    return "<tbody>\n" + "\n".join(rows) + "\n</tbody>"


def _figures(figures: Sequence[tuple[str, str, Path]]) -> str:
    """Return the section of the pictures, nothing if there are none."""
    if not figures:
        return ""
    return "<h2>Pictures</h2>\n" + "\n".join(_figure(*figure) for figure in figures)


def _figure(title: str, caption: str, path: Path) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    return (
        f"<figure>\n<figcaption><h3>{escape(title)}</h3>\n<p>{escape(caption)}</p></figcaption>\n"
        f'<img alt="{escape(title)}" src="data:image/png;base64,{data}">\n</figure>'
    )


def _terms(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what the words mean, as HTML."""
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
            "Cardinality error",
            "Mean over the scans of the absolute difference between the number of estimates and "
            "the number of targets.",
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
