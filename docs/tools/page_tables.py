"""Fills the tables of the pages on the study and on performance with the figures of the last runs.

A table stands between ``<!-- table: {...} -->`` and ``<!-- end -->``. The braces say what it has:

- ``{ospa: [CASE], variants: [...], lags: [...]}``: means with 95 % intervals, by lag;
- ``{ospa: [CASE, CASE ...], ...}``: a column for each case, with its lags divided by slashes;
- ``{figures: [KEY ...], cases: [...], variants: [...], lags: [...]}``: a column for each metric;
  with ``intervals: true`` the lags are divided by slashes, with 95 % intervals; `cases` may give
  the variants of each;
- ``{study: NAME, table: TITLE}``: the table of that title that ``studies NAME`` prints;
- ``{bench: TITLE}``: the table of that title that ``make bench`` prints.

A table whose run is not in out/study or out/bench, was a short one, lacks one of its rows, or has
fewer runs than the `runs` of its braces, is left as it is.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import yaml
from rich.table import Table

from benchmarks.results import report
from phd_jdtc_ros.evaluation.accumulator import Metric
from phd_jdtc_ros.study.definition import METRICS
from studies import command

ROOT = Path(__file__).parents[2]

PAGES = (
    *("study.md", "study_details.md", "performance.md", "engines.md", "registration.md"),
    *("scaling.md", "paper.md", "reports.md"),
)
STUDIES = ROOT / "out/study"
SUMMARIES = {"study": STUDIES / "summary.json", "bench": ROOT / "out/bench/summary.json"}
TABLE = re.compile(r"(?<=<!-- table: )(\{.*?\})( -->\n)(.*?)(?=<!-- end -->)", re.DOTALL)
ABSENT = ""
# Half the width of an interval below which lengths have two decimals, metres.
FINE = 0.2
# Fewer runs are not published, and no fewer than a table's own number.
FEWEST_RUNS = 10


def specified(page: str) -> Iterator[tuple[dict[str, Any], list[list[str]]]]:
    """Yield what each table of a page shows, and its cells, the headings first."""
    for found in TABLE.finditer(page):
        rows = [line.strip()[1:-1].split("|") for line in found[3].splitlines() if line[:1] == "|"]
        cells = [[cell.strip() for cell in row] for row in rows]
        yield yaml.safe_load(found[1]), [cells[0], *cells[2:]]


def filled(page: str, summaries: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return a page with the tables that the summaries have, and what those that stay lack."""
    missing: list[str] = []

    def table(found: re.Match[str]) -> str:
        shown = yaml.safe_load(found[1])
        try:
            text = _table(shown, summaries)
        except KeyError as fault:
            missing.append(f"left as it is: the table {found[1]}, for want of {fault}")
            return found[0]
        return f"{found[1]}{found[2]}{text}"

    return TABLE.sub(table, page), missing


def _table(shown: Mapping[str, Any], summaries: Mapping[str, Any]) -> str:
    if "bench" in shown:
        tables = {table.title: table for table in report.tables(summaries["bench"])}
        return _markdown(tables[shown["bench"]])
    if "study" in shown:
        name, found = shown["study"], summaries[shown["study"]]
        _require_runs(shown, len(found["seeds"]), name)
        parts = command.study_of(name).tables(found)
        tables = {part.title: part for part in parts if isinstance(part, Table)}
        return _markdown(tables[shown["table"]])
    cases = summaries["study"]["cases"]
    return "".join(f"| {' | '.join(row)} |\n" for row in study_rows(shown, cases))


def _markdown(table: Table) -> str:
    return report.markdown([table]).partition("\n\n")[2].rstrip() + "\n"


def _require_runs(shown: Mapping[str, Any], runs: int, name: str) -> None:
    """Raise a KeyError if a result has fewer runs than its table needs."""
    if runs < shown.get("runs", FEWEST_RUNS):
        raise KeyError(f"more than {runs} runs of {name}")


def study_rows(shown: Mapping[str, Any], cases: Mapping[str, Any]) -> list[list[str]]:
    """Return the cells of a study's table, headings and rule first."""
    rows = list((_metric_rows if "figures" in shown else _ospa_rows)(shown, cases))
    names = len(_names(shown)) if "figures" in shown else 1
    return [rows[0], [*["---"] * names, *["---:"] * (len(rows[0]) - names)], *rows[1:]]


def _ospa_rows(shown: Mapping[str, Any], cases: Mapping[str, Any]) -> Iterator[list[str]]:
    named, lags = shown["ospa"], [str(lag) for lag in shown["lags"]]
    alone = len(named) == 1
    yield ["variant", *([f"lag {lag}" for lag in lags] if alone else named)]
    for variant in shown["variants"]:
        of_cases = [_ospas(shown, cases[case], variant, lags) for case in named]
        if not any(any(cells) for cells in of_cases):
            raise KeyError(variant)
        yield [variant, *(of_cases[0] if alone else map(_joined, of_cases))]


def _ospas(
    shown: Mapping[str, Any], variants: Mapping[str, Any], name: str, lags: Sequence[str]
) -> list[str]:
    of_lags = _published(shown, variants, name) if name in variants else {}
    return [_cell(METRICS["ospa"], of_lags.get(lag), intervals=True) for lag in lags]


def _published(
    shown: Mapping[str, Any], variants: Mapping[str, Any], name: str
) -> Mapping[str, Any]:
    """Return a variant's lags; a KeyError says if it has too few runs."""
    _require_runs(shown, variants[name]["runs"], name)
    return variants[name]["lags"]


def _joined(cells: Sequence[str]) -> str:
    return " / ".join(filter(None, cells))


def _cell(metric: Metric, of_lag: Mapping[str, Any] | None, intervals: bool) -> str:
    """Return the mean of a metric over runs, with its interval or else with its unit."""
    mean = of_lag and of_lag["all"].get(metric.key)
    if not mean:
        return ABSENT
    if not intervals:
        return metric.text(mean["mean"])
    value, bounds = mean["mean"], mean["interval_95"]
    half = (bounds[1] - value,) if bounds else ()
    # A mean of counts has decimals, and so has a length whose interval is short.
    fine = metric.unit == "m" and bounds and half[0] < FINE
    form = ".2f" if fine else metric.form.replace(".0f", ".1f")
    return " ± ".join(f"{each:{form}}".rstrip("%") for each in (value, *half))


def _named(shown: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cases and variants of a table of metrics."""
    cases = shown["cases"]
    if isinstance(cases, Mapping):
        return [(case, variant) for case in cases for variant in cases[case]]
    return [*product(cases, shown["variants"])]


def _names(shown: Mapping[str, Any]) -> list[str]:
    """Return what a row of a table of metrics is named by; what all rows share is left out."""
    several = {
        "case": len(shown["cases"]) > 1,
        "variant": True,
        "lag": len(shown["lags"]) > 1 and "intervals" not in shown,
    }
    return [name for name, is_shown in several.items() if is_shown]


def _metric_rows(shown: Mapping[str, Any], cases: Mapping[str, Any]) -> Iterator[list[str]]:
    metrics, names = [METRICS[key] for key in shown["figures"]], _names(shown)
    intervals, lags = "intervals" in shown, [*map(str, shown["lags"])]
    units = (", %" if m.form[-1] == "%" else m.unit and f", {m.unit}" for m in metrics)
    yield [*names, *(m.heading + unit * intervals for m, unit in zip(metrics, units, strict=True))]
    for (case, variant), row_lags in product(
        _named(shown), [lags] if intervals else [[lag] for lag in lags]
    ):
        found = _published(shown, cases[case], variant)
        row = {"case": case, "variant": variant, "lag": row_lags[0]}
        cells = [
            _joined([_cell(m, found.get(lag), intervals) for lag in row_lags]) for m in metrics
        ]
        if not any(cells):
            raise KeyError(variant)
        yield [*(row[name] for name in names), *cells]


def main() -> int:
    """Fill the tables of the pages; say which stay as they are."""
    paths = {**{path.stem: path for path in STUDIES.glob("*.json")}, **SUMMARIES}
    found = {name: json.loads(p.read_text()) for name, p in paths.items() if p.exists()}
    summaries = {name: summary for name, summary in found.items() if not summary.get("quick")}
    for name in PAGES:
        path = ROOT / "docs" / name
        text, missing = filled(path.read_text(encoding="utf-8"), summaries)
        path.write_text(text, encoding="utf-8")
        print(*missing, sep="\n", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
