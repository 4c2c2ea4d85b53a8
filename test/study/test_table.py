import io

import numpy as np
import pytest
from rich.console import Console

from phd_jdtc_ros.core.evaluation import Evaluation, PointSet
from phd_jdtc_ros.study.table import metrics, ospa_table


def points(rows, classes):
    return PointSet(np.array(rows, dtype=float).reshape(-1, 2), np.array(classes, dtype=int))


@pytest.fixture
def evaluation():
    found = Evaluation(classes=2, cutoff=1000.0, order=2.0)
    found.add_truth(1, points([[0, 0]], [0]))
    found.add_truth(2, points([[0, 0]], [0]))
    found.add_estimates("filtered", 1, points([[0, 80]], [0]))
    found.add_estimates("filtered", 2, points([[0, 120]], [0]))
    found.add_estimates("smoothed", 1, points([[0, 20]], [0]))
    found.add_estimates("smoothed", 2, points([[0, 30]], [0]))
    return found


def lines(summary):
    """Return the table as printed: title, rows of cells, caption."""
    stream = io.StringIO()
    Console(file=stream, width=120).print(ospa_table(summary))
    text = stream.getvalue().splitlines()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text if "│" in line]
    return text[0].strip(), rows, text[-1].strip()


def test_metrics_are_the_summary_and_the_step_times(evaluation):
    found = metrics(evaluation, np.array([1.0, 2.0, 3.0, 10.0]))
    assert found.pop("step_ms") == {
        "median": 2.5,
        "p99": pytest.approx(10.0 - 0.03 * 7.0),
    }
    assert found == evaluation.summary()


def test_metrics_hold_what_the_file_promises(evaluation):
    found = metrics(evaluation, np.ones(2))
    assert set(found) == {
        "filtered", "smoothed", "reduction", "class_accuracy", "p", "c", "scans", "step_ms",
    }  # fmt: skip
    for source in ("filtered", "smoothed"):
        assert list(found[source]) == ["all", "class_0", "class_1"]
        for means in found[source].values():
            assert list(means) == ["ospa", "localization", "cardinality", "cardinality_abs_error"]
    assert found["filtered"]["all"]["ospa"] == pytest.approx(100.0)
    assert found["smoothed"]["all"]["ospa"] == pytest.approx(25.0)
    assert found["reduction"] == pytest.approx(0.75)
    assert (found["class_accuracy"], found["p"], found["c"], found["scans"]) == (
        1.0,
        2.0,
        1000.0,
        2,
    )


def test_metrics_without_step_times_have_none(evaluation):
    assert "step_ms" not in metrics(evaluation, np.zeros(0))


def test_ospa_table_shows_both_sources_and_the_reduction_of_every_set(evaluation):
    _, rows, _ = lines(metrics(evaluation, np.zeros(0)))
    assert rows == [
        ["all", "filter", "100.0 m", "100.0 m", "0.0 m", "0.000"],
        ["", "smoother", "25.0 m", "25.0 m", "0.0 m", "0.000"],
        ["", "reduction", "75%", "75%", "-", "-"],
        ["class 0", "filter", "100.0 m", "100.0 m", "0.0 m", "0.000"],
        ["", "smoother", "25.0 m", "25.0 m", "0.0 m", "0.000"],
        ["", "reduction", "75%", "75%", "-", "-"],
        ["class 1", "filter", "0.0 m", "0.0 m", "0.0 m", "0.000"],
        ["", "smoother", "0.0 m", "0.0 m", "0.0 m", "0.000"],
        ["", "reduction", "-", "-", "-", "-"],
    ]


def test_ospa_table_says_what_it_is_of(evaluation):
    title, _, caption = lines(metrics(evaluation, np.array([1.25, 1.25])))
    assert title == "means over 2 scans (OSPA: p = 2, c = 1000 m)"
    assert caption == "right class: 100.0%; CPU a scan: median 1.2 ms, p99 1.2 ms"


def test_ospa_table_leaves_out_what_was_not_measured(evaluation):
    _, _, caption = lines(metrics(evaluation, np.zeros(0)))
    assert caption == "right class: 100.0%"


def test_ospa_table_of_nothing_shows_dashes():
    empty = Evaluation(classes=1, cutoff=500.0, order=1.0)
    title, rows, _ = lines(metrics(empty, np.zeros(0)))
    assert title == "means over 0 scans (OSPA: p = 1, c = 500 m)"
    assert [row[2:] for row in rows] == [["-"] * 4] * 6


def test_ospa_table_shows_a_loss_as_negative(evaluation):
    summary = metrics(evaluation, np.zeros(0))
    summary["filtered"], summary["smoothed"] = summary["smoothed"], summary["filtered"]
    _, rows, _ = lines(summary)
    assert rows[2] == ["", "reduction", "-300%", "-300%", "-", "-"]
