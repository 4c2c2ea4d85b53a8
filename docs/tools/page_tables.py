"""Fills the tables of the pages on the study and on performance with the figures of the last runs.

A table stands between ``<!-- table: {...} -->`` and ``<!-- end -->``. The braces say what it has:

- ``{ospa: [CASE], variants: [...], lags: [...]}``: means with 95 % intervals, by lag;
- ``{ospa: [CASE, CASE ...], ...}``: a column for each case, with its lags divided by slashes;
- ``{figures: [KEY ...], cases: [...], variants: [...], lags: [...]}``: a column for each metric;
- ``{bench: TITLE}``: the table of that title that ``make bench`` prints.

A table whose run is not in out/study or out/bench, was a short one, or lacks one of its rows, is
left as it is.
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

from benchmarks.results import report
from phd_jdtc_ros.study.monte_carlo.definition import METRICS

ROOT = Path(__file__).parents[2]

PAGES = ("study.md", "study_details.md", "performance.md")
SUMMARIES = {"study": "out/study/summary.json", "bench": "out/bench/summary.json"}
TABLE = re.compile(r"(?<=<!-- table: )(\{.*?\})( -->\n)(.*?)(?=<!-- end -->)", re.DOTALL)
ABSENT = ""
# Variants with fewer runs are not published.
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
        text = report.markdown([tables[shown["bench"]]])
        return text.partition("\n\n")[2].rstrip() + "\n"
    cases = summaries["study"]["cases"]
    return "".join(f"| {' | '.join(row)} |\n" for row in study_rows(shown, cases))


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
        of_cases = [_ospas(cases[case], variant, lags) for case in named]
        if not any(any(cells) for cells in of_cases):
            raise KeyError(variant)
        yield [variant, *(of_cases[0] if alone else map(_joined, of_cases))]


def _ospas(variants: Mapping[str, Any], name: str, lags: Sequence[str]) -> list[str]:
    of_lags = _published(variants, name) if name in variants else {}
    return [_interval(of_lags[lag]["all"]["ospa"]) if lag in of_lags else ABSENT for lag in lags]


def _published(variants: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a variant's lags; a KeyError says if it has too few runs."""
    if variants[name]["runs"] < FEWEST_RUNS:
        raise KeyError(f"more than {variants[name]['runs']} runs of {name}")
    return variants[name]["lags"]


def _joined(cells: Sequence[str]) -> str:
    return " / ".join(cells) if any(cells) else ABSENT


def _interval(mean: Mapping[str, Any]) -> str:
    bounds = mean["interval_95"]
    return f"{mean['mean']:.1f}" + (f" ± {bounds[1] - mean['mean']:.1f}" if bounds else "")


def _names(shown: Mapping[str, Any]) -> list[str]:
    """Return what a row of a table of metrics is named by; what all rows share is left out."""
    several = {"case": len(shown["cases"]) > 1, "variant": True, "lag": len(shown["lags"]) > 1}
    return [name for name, is_shown in several.items() if is_shown]


def _metric_rows(shown: Mapping[str, Any], cases: Mapping[str, Any]) -> Iterator[list[str]]:
    metrics, names = [METRICS[key] for key in shown["figures"]], _names(shown)
    yield [*names, *(metric.heading for metric in metrics)]
    for case, variant, lag in product(shown["cases"], shown["variants"], map(str, shown["lags"])):
        found = _published(cases[case], variant)[lag]["all"]
        means = [found.get(metric.key) for metric in metrics]
        texts = [
            ABSENT if mean is None else metric.text(mean["mean"])
            for metric, mean in zip(metrics, means, strict=True)
        ]
        row = {"case": case, "variant": variant, "lag": lag}
        yield [*(row[name] for name in names), *texts]


def main() -> int:
    """Fill the tables of the pages; say which stay as they are."""
    found = {
        name: json.loads((ROOT / path).read_text())
        for name, path in SUMMARIES.items()
        if (ROOT / path).exists()
    }
    summaries = {name: summary for name, summary in found.items() if not summary.get("quick")}
    for name in PAGES:
        path = ROOT / "docs" / name
        text, missing = filled(path.read_text(encoding="utf-8"), summaries)
        path.write_text(text, encoding="utf-8")
        print(*missing, sep="\n", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
