import io

import numpy as np
import pytest
from rich.console import Console

from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import GLOBAL_METRICS, SET_METRICS, Evaluation
from phd_jdtc_ros.report.table import metrics, score_tables, unscored_note


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


def printed(summary, width=80):
    """Return the lines of the tables as printed."""
    stream = io.StringIO()
    Console(file=stream, width=width).print(score_tables(summary))
    return stream.getvalue().splitlines()


def tables(summary):
    """Return each table as printed: title, rows of cells, lines of the caption."""
    found, block = [], []
    for line in [*printed(summary), ""]:
        if line.strip():
            block.append(line)
            continue
        edges = [n for n, text in enumerate(block) if text.startswith(("┏", "└"))]
        rows = [[cell.strip() for cell in text.split("│")[1:-1]] for text in block if "│" in text]
        title, caption = (
            [text.strip() for text in part] for part in (block[: edges[0]], block[edges[1] + 1 :])
        )
        found.append((" ".join(title), rows, caption))
        block = []
    return found


def test_metrics_are_the_summary_with_step_times_and_engine(evaluation):
    found = metrics(evaluation, np.array([1.0, 2.0, 3.0, 10.0]))
    assert found.pop("step_ms") == {"median": 2.5, "p99": pytest.approx(10.0 - 0.03 * 7.0)}
    assert found == evaluation.summary()
    assert metrics(evaluation, np.zeros(0), "gaussian")["engine"] == "gaussian"
    assert "engine" not in metrics(evaluation, np.zeros(0))


def test_metrics_hold_what_the_file_promises(evaluation):
    found = metrics(evaluation, np.ones(2))
    assert set(found) == {
        "filtered", "smoothed", "reduction", "class_accuracy", "p", "c", "scans", "step_ms",
        "truth_scans", "long_gap_s", "ospa2_window", "identity_switches", "class_names",
        "consistency", "false_per_scan", "least_speed", "slow_targets"
    }  # fmt: skip
    promised = {
        "ospa", "localization", "cardinality", "cardinality_abs_error",
        "gospa", "gospa_localization", "missed", "false", "position_rms", "position_detection",
        "longest_gap_s", "long_gap_share", "long_gap_misses"
    }  # fmt: skip
    of_sets = [metric.key for metric in SET_METRICS]
    assert promised <= {*of_sets}
    for source in ("filtered", "smoothed"):
        assert list(found[source]) == ["all", "class_0", "class_1"]
        everything = found[source].pop("all")
        assert list(everything) == [
            *of_sets,
            *(metric.key for metric in GLOBAL_METRICS),
            "confusion",
        ]
        assert "ospa2" in everything
        assert [list(means) for means in found[source].values()] == [of_sets] * 2
        found[source]["all"] = everything
    assert found["filtered"]["all"]["ospa"] == pytest.approx(100.0)
    assert found["smoothed"]["all"]["ospa"] == pytest.approx(25.0)
    assert found["reduction"] == pytest.approx(0.75)
    assert (found["class_accuracy"], found["p"], found["c"], found["scans"]) == (
        1.0,
        2.0,
        1000.0,
        2,
    )


def test_scans_and_targets_without_a_score_are_counted(evaluation):
    note = unscored_note({"least_speed": 2.5, "slow_targets": 3.0})
    assert note.startswith("Targets slower than 2.5 m/s are not scored, 3.0 on average")
    assert unscored_note({"least_speed": 2.5, "slow_targets": 0.0}) == ""
    evaluation.add_truth(99, points([], []))
    (title, *_), *_ = tables(metrics(evaluation, np.zeros(0)))
    assert title.startswith("means over 2 of 3 scans (OSPA: ")


def test_score_tables_show_the_papers_filter_above_the_tracker(evaluation):
    live = metrics(evaluation, np.array([4.0]), "gaussian")
    other = metrics(evaluation, np.array([2.0]), "phd")
    other["smoothed"]["all"]["ospa"] = 50.0
    title, rows, _ = tables({**live, "compared": [other]})[-1]
    assert "the paper's filter" in title
    assert rows[-2:] == [
        ["phd, offline", "100.0 m", "50.0 m", "50%", "100.0%", "2.0 ms"],
        ["gaussian, live", "100.0 m", "25.0 m", "75%", "100.0%", "4.0 ms"],
    ]
    assert not [table for table in tables(live) if "the paper's filter" in table[0]]


def test_score_tables_shows_both_sources_and_the_reduction_of_every_set(evaluation):
    (_, rows, _), *_ = tables(metrics(evaluation, np.zeros(0)))
    nothing = ["0.0 m", "0.0 m", "0.0 m", "0.000"]
    assert rows == [
        ["all", "filter", "100.0 m", "100.0 m", "0.0 m", "0.000"],
        ["", "smoother", "25.0 m", "25.0 m", "0.0 m", "0.000"],
        ["", "reduction", "75%", "75%", "-", "-"],
        ["class 0", "filter", "100.0 m", "100.0 m", "0.0 m", "0.000"],
        ["", "smoother", "25.0 m", "25.0 m", "0.0 m", "0.000"],
        ["", "reduction", "75%", "75%", "-", "-"],
        ["class 1", "filter", *nothing],
        ["", "smoother", *nothing],
        ["", "reduction", *["-"] * 4],
    ]


def test_score_tables_shows_the_surveillance_figures():
    truth = [points([[0, 0]], [0]), points([[5000, 0]], [1])]
    found = Evaluation(classes=2, cutoff=1000.0, order=2.0)
    for stamp, target in enumerate(truth):
        label = np.array([1 + stamp])
        found.add_truth(stamp, PointSet(target.position, target.class_id, label))
        found.add_estimates("smoothed", stamp, points([[0, 80]], [0]))
    _, _, (_, rows, caption), *_ = tables(metrics(found, np.zeros(0)))
    assert rows == [
        ["all", "filter", *["-"] * 5],
        ["", "smoother", "80.0 m", "50.00%", "0.0 s", "0.0%", "0.00%"],
        ["class 0", "filter", *["-"] * 5],
        ["", "smoother", "80.0 m", "100.00%", "0.0 s", "0.0%", "0.00%"],
        ["class 1", "filter", *["-"] * 5],
        ["", "smoother", "-", "0.00%", "0.0 s", "0.0%", "0.00%"],
    ]
    assert caption == [
        "long gaps: over 16.4 s between estimates",
        "false per scan: filter -, smoother 0.500",
        "within 500 m: filter -, smoother 50.00%",
        "no OSPA(2) and no identity switches: the estimates carry no track ids",
    ]


def test_score_tables_shows_the_figures_of_tracks_where_there_are_any(evaluation):
    summary = metrics(evaluation, np.zeros(0))
    summary["smoothed"]["all"] |= {"ospa2": 12.34, "identity_switches": 3.0}
    _, _, (_, _, caption), *_ = tables(summary)
    assert caption[1:] == [
        "OSPA(2): filter -, smoother 12.3 m",
        "identity switches: filter -, smoother 3",
        "false per scan: filter 0.000, smoother 0.000",
        "within 500 m: filter 100.00%, smoother 100.00%",
    ]


@pytest.fixture
def stated():
    """Estimates 10 m off with a deviation of 10 m; smoothed ones 40 m off with the same."""
    found = Evaluation(classes=1, cutoff=1000.0, order=2.0)
    covariance = np.full((1, 2, 2), 100.0 * np.eye(2))
    for stamp in range(7):
        found.add_truth(stamp, points([[0, 0]], [0]))
        for source, off in (("filtered", 10.0), ("smoothed", 40.0)):
            place = np.array([[off, 0.0]])
            estimate = PointSet(place, np.array([0]), np.array([3]), covariance=covariance)
            found.add_estimates(source, stamp, estimate)
    return metrics(found, np.zeros(0))


def test_score_tables_shows_the_consistency_of_stated_covariances(stated):
    *_, (title, rows, caption), (other, shares, _) = tables(stated)
    assert title == "NEES / 2 of positions, by age in scans"
    assert rows == [
        ["class 0", "filter", "0.500", "0.500", "0.500", "-"],
        ["", "smoother", "8.00", "8.00", "8.00", "-"],
    ]
    assert caption == [
        "95 % band of 7 pairs, filter: 0.40 to 1.87",
        "95 % band of 7 pairs, smoother: 0.40 to 1.87",
    ]
    assert other == "positions outside 3 sigma, by age in scans"
    assert [row[1:] for row in shares] == [
        ["filter", "0.0%", "0.0%", "0.0%", "-"],
        ["smoother", "100.0%", "100.0%", "100.0%", "-"],
    ]


def test_score_tables_have_configured_names_and_what_was_measured(evaluation):
    named = {**metrics(evaluation, np.zeros(0)), "class_names": ["car", "[red]van_2"]}
    (_, rows, _), *_, (_, matrix, _) = tables(named)
    assert [row[0] for row in rows if row[0]] == ["all", "car", "[red]van_2"]
    assert [row[0] for row in matrix] == ["car", "[red]van_2", "none (false)"]
    (title, _, caption), *_ = tables(metrics(evaluation, np.array([1.25, 1.25])))
    assert title == "means over 2 scans (OSPA: p = 2, c = 1000 m)"
    assert caption == ["right class: 100.0%", "CPU per scan: median 1.2 ms, p99 1.2 ms"]
    (_, _, caption), *_ = tables(metrics(evaluation, np.zeros(0)))
    assert caption == ["right class: 100.0%"]


def test_score_tables_shows_a_single_class_once():
    found = Evaluation(classes=1, cutoff=1000.0, order=2.0, class_names=("car",))
    for source in ("filtered", "smoothed"):
        found.add_estimates(source, 1, points([[0, 0.5]], [0]))
    found.add_truth(1, points([[0, 0]], [0]))
    (_, rows, caption), *others = tables(metrics(found, np.zeros(0)))
    assert [row[:3] for row in rows] == [
        ["car", "filter", "0.50 m"],
        ["", "smoother", "0.50 m"],
        ["", "reduction", "0%"],
    ]
    assert caption == []
    assert not [title for title, *_ in others if "class" in title]


def test_score_tables_shows_what_the_smoother_took_targets_for(evaluation):
    evaluation.add_truth(3, points([[0, 0], [5000, 0]], [0, 1]))
    evaluation.add_estimates("smoothed", 3, points([[0, 0], [9000, 0]], [1, 0]))
    *_, (title, rows, _) = tables(metrics(evaluation, np.zeros(0)))
    assert title == "smoother: true against estimated class"
    assert rows == [
        ["class 0", "2", "1", "0"],
        ["class 1", "0", "0", "1"],
        ["none (false)", "1", "0", ""],
    ]


def test_score_tables_fits_80_columns():
    """With figures as large as they get."""
    found = Evaluation(classes=3, cutoff=1000.0, order=2.0)
    rng = np.random.default_rng(0)
    for stamp in range(50):
        found.add_truth(stamp, points(rng.uniform(-1e5, 1e5, (100, 2)), rng.integers(0, 3, 100)))
        for source in ("filtered", "smoothed"):
            estimates = points(rng.uniform(-1e5, 1e5, (100, 2)), rng.integers(0, 3, 100))
            found.add_estimates(source, stamp, estimates)
    lines = printed(metrics(found, np.ones(50)), width=200)
    text = "\n".join(printed(metrics(found, np.ones(50))))
    assert max(len(line.rstrip().lstrip()) for line in lines) <= 80
    assert "…" not in text


def test_score_tables_of_nothing_shows_dashes():
    empty = Evaluation(classes=1, cutoff=500.0, order=1.0)
    (title, rows, _), (_, parts, _), (_, more, _) = tables(metrics(empty, np.zeros(0)))
    assert title == "means over 0 scans (OSPA: p = 1, c = 500 m)"
    assert [row[2:] for row in rows] == [["-"] * 4] * 3
    assert [row[2:] for row in parts] == [["-"] * 4] * 2
    assert [row[2:] for row in more] == [["-"] * 5] * 2
