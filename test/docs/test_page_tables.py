"""The tables of the pages on the study and performance, and the curves drawn from them."""

from pathlib import Path

import curves
import page_tables
import pytest
import yaml

from phd_jdtc_ros.study.definition import METRICS
from studies import handover

ROOT = Path(__file__).parents[2]
PAGES = [(ROOT / "docs" / name).read_text() for name in page_tables.PAGES]
DEFINED = yaml.safe_load((ROOT / "config" / "studies" / "published.yaml").read_text())
OF_STUDY = [
    (shown, cells)
    for page in PAGES
    for shown, cells in page_tables.specified(page)
    if not {"bench", "study"} & {*shown}
]


def figures(mean):
    """Return the figures of one lag."""
    return {"all": {"ospa": {"mean": mean, "interval_95": [mean - 2.0, mean + 2.0]}}}


SUMMARY = {
    "one": {"ours": {"runs": 20, "lags": {"0": figures(90.0), "5": figures(50.04)}}},
    "two": {
        "ours": {"runs": 20, "lags": {"0": figures(80.0), "5": figures(40.0)}},
        "theirs": {
            "runs": 20,
            "lags": {"0": {"all": {"ospa": {"mean": 70.0, "interval_95": None}}}},
        },
    },
}
PAGE = """Before.

<!-- table: {ospa: [one], variants: [ours], lags: [0, 5]} -->
| variant | lag 0 | lag 5 |
| --- | ---: | ---: |
| ours | 1.0 | 2.0 |
<!-- end -->

After.
"""


def test_filled_replaces_the_rows_of_tables_of_study_and_benchmark():
    text, missing = page_tables.filled(PAGE, {"study": {"cases": SUMMARY}})

    assert missing == []
    assert text == PAGE.replace("| ours | 1.0 | 2.0 |", "| ours | 90.0 ± 2.0 | 50.0 ± 2.0 |")
    times = {"gaussian": {"median_ms": 20.0}, "GM-PHD": {"median_ms": 40.0}}
    title = "a scan of the reference scenario, both radars"
    page = f"<!-- table: {{bench: '{title}'}} -->\nold\n<!-- end -->\n"

    text, missing = page_tables.filled(page, {"bench": {"peers": times, "figures": []}})

    assert missing == []
    assert "\n| GM-PHD | 40 ms | 2 |\n<!-- end -->\n" in text


@pytest.mark.parametrize(
    ("summaries", "lacking"),
    [
        ({}, "study"),
        ({"study": {"cases": {}}}, "one"),
        ({"study": {"cases": {"one": {}}}}, "ours"),
        ({"study": {"cases": {"one": {"ours": {"runs": 2}}}}}, "more than 2 runs of ours"),
    ],
)
def test_filled_leaves_a_table_whose_run_is_missing(summaries, lacking):
    text, (line,) = page_tables.filled(PAGE, summaries)

    assert text == PAGE
    assert line.endswith(f"for want of '{lacking}'")


def test_study_rows_have_columns_of_cases_or_of_figures_with_units():
    shown = {"ospa": ["one", "two"], "variants": ["ours", "theirs"], "lags": [0]}

    assert page_tables.study_rows(shown, SUMMARY) == [
        ["variant", "one", "two"],
        ["---", "---:", "---:"],
        ["ours", "90.0 ± 2.0", "80.0 ± 2.0"],
        ["theirs", "", "70.0"],
    ]
    shown = {"figures": ["ospa", "nees"], "cases": ["one"], "variants": ["ours"], "lags": [5]}

    assert page_tables.study_rows(shown, SUMMARY)[0::2] == [
        ["variant", METRICS["ospa"].heading, METRICS["nees"].heading],
        ["ours", "50.0 m", ""],
    ]


def test_study_rows_with_intervals_join_the_lags_and_have_units_in_the_headings():
    lags = {"0": figures(0.5), "5": figures(40.0)}
    lags["0"]["all"]["class_accuracy"] = {"mean": 0.5, "interval_95": [0.4, 0.6]}
    found = {"one": {"ours": {"runs": 20, "lags": lags}}, "two": SUMMARY["two"]}
    shown = {
        "figures": ["ospa", "class_accuracy"],
        "cases": {"one": ["ours"], "two": ["theirs"]},
        "lags": [0, 5],
        "intervals": True,
    }

    assert page_tables.study_rows(shown, found) == [
        ["case", "variant", "OSPA, m", "class accuracy, %"],
        ["---", "---", "---:", "---:"],
        ["one", "ours", "0.5 ± 2.0 / 40.0 ± 2.0", "50.0 ± 10.0"],
        ["two", "theirs", "70.0", ""],
    ]


def test_tables_of_other_studies_are_those_that_they_print():
    scores = {"gospa": 282.0, "ospa": 63.0, "switches": 0.5, "missing": 0.0, "duplicated": 0.25}
    figures = {"scores": {"one tracker": scores}, "cpu_s": {}, "seeds": [*range(12)]}
    table, *_ = handover.STUDY.tables(figures)
    page = f"<!-- table: {{study: handover, table: {table.title}, runs: 12}} -->\n<!-- end -->\n"

    text, missing = page_tables.filled(page, {"handover": figures})

    assert missing == []
    assert "\n| one tracker | 282 m | 63 m | 0.5 | 0.00 | 0.25 |\n<!-- end -->\n" in text
    text, (line,) = page_tables.filled(page, {"handover": {**figures, "seeds": [1, 2]}})
    assert text == page
    assert "more than 2 runs of handover" in line


@pytest.mark.parametrize(("shown", "cells"), OF_STUDY, ids=[str(shown) for shown, _ in OF_STUDY])
def test_tables_of_the_study_have_the_rows_and_columns_that_they_name(shown, cells):
    cases = shown.get("cases", shown.get("ospa"))
    found = {case: {name: _of_lags(shown) for name in variants_of(shown)} for case in cases}
    expected = page_tables.study_rows(shown, found)

    assert {*cases} <= {*DEFINED["cases"]}
    assert variants_of(shown) <= {*DEFINED["variants"]}
    assert cells[0] == expected[0]
    names = expected[1].count("---")
    assert [row[:names] for row in cells[1:]] == [row[:names] for row in expected[2:]]


def variants_of(shown):
    """Return the variants that a table names."""
    cases = shown.get("cases")
    of_cases = cases.values() if isinstance(cases, dict) else [shown["variants"]]
    return {name for names in of_cases for name in names}


def _of_lags(shown):
    metrics = {key: {"mean": 1.0, "interval_95": None} for key in shown.get("figures", ["ospa"])}
    return {"runs": 20, "lags": {str(lag): {"all": metrics} for lag in shown["lags"]}}


def test_equal_figures_of_the_study_stand_in_all_its_tables_alike():
    rows = {}
    for shown, cells in OF_STUDY:
        if shown.get("ospa") == ["clutter 20"]:
            for name, *values in cells[1:]:
                for lag, value in zip(cells[0][1:], values, strict=True):
                    rows.setdefault((name, lag), set()).add(value)

    assert {key for key, values in rows.items() if len(values) > 1} == set()
    assert len(rows) > 100


def test_curves_end_where_the_rows_end_and_have_their_labels_there(tmp_path):
    curves.write_all(ROOT / "docs", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "ospa_against_lag.png",
        "step_against_targets.png",
    }
    (cells,) = [
        cells
        for shown, cells in OF_STUDY
        if "ospa" in shown and {*curves.CORRECTIONS} <= {*shown["variants"]}
    ]

    (axes,) = curves.over_lag(cells).axes

    ends = {text.get_text(): text.xy for text in axes.texts}
    assert len(axes.lines) == len(ends) == 4
    reference = next(row for row in cells if row[0] == "reference")
    last = float(reference[-1].split(" ")[0])
    assert ends[curves.CORRECTIONS["reference"]] == (10.0, last)
