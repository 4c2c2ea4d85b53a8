"""The tables of the pages on the study and performance, and the curves drawn from them."""

from pathlib import Path

import page_tables
import pytest
import yaml

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
