import math
import re
import struct
from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.report import style
from phd_jdtc_ros.study import figures
from phd_jdtc_ros.study.definition import KINDS, Study, Variant
from phd_jdtc_ros.study.figures import band, markdown, tables, write_all
from phd_jdtc_ros.study.metrics import VALUES
from phd_jdtc_ros.study.results import Mean, Result, summarise
from phd_jdtc_ros.study.tasks import Scores

SCANS = 6
OVER_TIME = {
    "ospa_over_time",
    "parts_over_time",
    "number_error_over_time",
    "class_accuracy_over_time",
}


def variant_of(name, kind="gaussian", lags=(0, 2, 5)):
    return Variant(name, KINDS[kind], {}, ("quiet",), lags)


def result_of(variant, runs=3, scans=SCANS, sets=("all", "class_0", "class_1"), case="quiet"):
    """Random scores around 100 m."""
    rng = np.random.default_rng(len(variant.name))
    values = rng.uniform(80.0, 120.0, (runs, len(variant.lags), scans, len(sets), len(VALUES)))
    for name, number in (("n_true", 2), ("n_est", 3), ("pairs", 2), ("right_class", 1)):
        values[..., VALUES.index(name)] = number
    scores = Scores(variant.lags, sets, 6.0 * np.arange(scans), values)
    return Result(case, variant, tuple(range(runs)), scores)


def everything(**options):
    return [
        result_of(variant_of("corrected"), **options),
        result_of(variant_of("as printed"), **options),
        result_of(variant_of("reference", "reference"), **options),
        result_of(variant_of("GNN", "gnn", (0,)), **{**options, "sets": ("all",)}),
    ]


def summary_of(results):
    return summarise(Study((), (), (), {}), results, [], [])


def names(pictures):
    return {picture.stem for picture in pictures}


def without_targets():
    result = result_of(variant_of("filter alone", lags=(0,)))
    result.scores.values[...] = 0.0
    return [result]


def test_write_all_writes_every_picture_1200_pixels_wide(tmp_path):
    pictures = write_all(everything(), tmp_path / "new")
    assert names(pictures) == {"ospa_against_lag"} | OVER_TIME
    for picture in pictures:
        data = picture.read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        assert struct.unpack(">II", data[16:24])[0] == 1200
        assert picture.parent.name == "quiet"


@pytest.mark.parametrize(
    "results",
    [everything(runs=1, scans=1), without_targets()],
    ids=["one run of one scan", "filter alone without targets"],
)
def test_write_all_draws_results_that_lack_something(tmp_path, results, monkeypatch):
    for module in (style, figures):  # Fewer pixels take less time
        monkeypatch.setattr(module, "DPI", 20)
    assert names(write_all(results, tmp_path)) == {"ospa_against_lag"} | OVER_TIME


def test_write_all_has_a_directory_for_each_case_and_no_time_without_our_tracker(tmp_path):
    peer = result_of(variant_of("GNN", "gnn", (0,)), sets=("all",))
    pictures = write_all([peer, replace(peer, case="clutter 20")], tmp_path)
    assert names(pictures) == {"ospa_against_lag"}
    assert {path.name for path in tmp_path.iterdir()} == {"quiet", "clutter_20"}


def test_over_time_draws_filter_and_lag_5_of_the_first_variant():
    results = everything()
    filtered, smoothed = figures.ospa_over_time(results).axes[-1].lines
    for line, lag in ((filtered, 0), (smoothed, 5)):
        mean = results[0].value("ospa", lag).mean(axis=0)
        np.testing.assert_allclose(line.get_ydata(), mean)


def test_band_is_the_interval_of_the_mean():
    runs = np.random.default_rng(0).normal(size=(5, 3))
    runs[0, 0] = math.nan
    runs[1:, 1] = math.nan
    mean, half_width = band(runs)
    for column in (0, 2):
        expected = Mean.of(runs[:, column])
        assert (mean[column], half_width[column]) == pytest.approx(tuple(expected))
    assert (mean[1], half_width[1]) == (runs[0, 1], 0.0)


def test_markdown_has_a_row_for_each_variant():
    text = markdown(summary_of(everything()))
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert rows[0] == "| variant | runs | 0 | 2 | 5 | false at 0 |"
    assert [row.split(" | ")[0] for row in rows[2:6]] == [
        "| corrected",
        "| as printed",
        "| reference",
        "| GNN",
    ]
    assert "±" in rows[2]
    assert re.search(r"\| - \| - \| \d+\.\d{3} \|$", rows[5])


def test_tables_show_the_consistency_of_those_that_state_covariances():
    stated, silent = result_of(variant_of("corrected")), result_of(variant_of("GNN", "gnn", (0,)))
    silent.scores.values[..., [VALUES.index(name) for name in VALUES if "judged" in name]] = 0
    text = markdown(summary_of([stated, silent]))
    _, _, after = text.partition("Covariances of positions")
    rows = [line.split(" | ") for line in after.partition("## ")[0].splitlines() if "|" in line]
    assert rows[0][:5] == ["| variant", "runs", "lag", "NEES", "outside 3 sigma"]
    assert [row[0] for row in rows[2:]] == ["| corrected"] * 3
    titles = [table.title for table in tables(summary_of([stated, silent]))]
    assert titles[1] == "quiet: covariances of positions, by lag in scans"
    assert len(list(tables(summary_of([silent])))) == 1
