from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.evaluation.metric_table import METRICS, OSPA, VALUES, reduction, values_of
from phd_jdtc_ros.evaluation.scan_scores import Comparison, PointSet
from phd_jdtc_ros.evaluation.surveillance import Gap
from phd_jdtc_ros.evaluation.totals import Totals
from phd_jdtc_ros.evaluation.track_ages import NO_AGE

NAMES = tuple(VALUES)


def points(*rows):
    """Return a point set of (x, y, class) rows."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return PointSet(table[:, :2], table[:, 2].astype(int))


@pytest.fixture
def scan():
    """Two targets, one found 50 m off as of the other class, and two false estimates."""
    truth = points((0, 0, 0), (5000, 0, 1))
    estimate = points((30, 40, 1), (-9000, 0, 0), (9000, 0, 0))
    gaps = (Gap(0, 12.0, 1), Gap(0, 18.0, 2), Gap(1, 16.4, 3))
    pair = truth.only(np.array([0])), estimate.only(np.array([0])), np.array([NO_AGE])
    labels = {"ospa2": None, "identity_switches": None, "seen_switches": None}
    return Comparison(truth, estimate, *pair, cutoff=1000.0, order=2.0, gaps=gaps, **labels)


def test_values_of_a_scan_are_those_of_the_table(scan):
    expected = {
        "ospa": pytest.approx(np.sqrt((50.0**2 + 2e6) / 3.0)),
        "localization": pytest.approx(np.sqrt((50.0**2 + 1e6) / 3.0)),
        "cardinality": pytest.approx(np.sqrt(1e6 / 3.0)),
        "gospa": pytest.approx(np.sqrt(50.0**2 + 1.5e6)),
        "gospa_localization": pytest.approx(50.0),
        "missed": 1,
        "false": 2,
        "n_true": 2,
        "n_est": 3,
        "cardinality_abs_error": 1,
        "pairs": 1,
        "right_class": 0,
        "square_error": pytest.approx(2500.0),
        "gaps": 3,
        "long_gaps": 1,
        "missed_in_long_gaps": 2,
        "longest_gap_s": 18.0,
        "ospa2": None,
        "identity_switches": None,
        "seen_switches": None,
    }
    values = values_of(scan)
    assert {name: values[name] for name in expected} == expected
    assert [*values] == [*NAMES]


@pytest.mark.parametrize(("gaps", "expected"), [((), 0), (None, None)])
def test_values_without_gaps_are_zero_and_without_labels_not_known(scan, gaps, expected):
    values = values_of(replace(scan, gaps=gaps))
    for name in ("gaps", "long_gaps", "missed_in_long_gaps", "longest_gap_s"):
        assert values[name] == expected


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.key)
def test_every_metric_has_figures_of_several_runs_and_none_of_no_scan(metric):
    runs = Totals.of(NAMES, np.ones((3, 5, len(NAMES))))
    assert np.isfinite(metric.of_run(runs)).tolist() == [True] * 3
    assert np.isnan(metric.of_run(Totals.of(NAMES, np.zeros((0, len(NAMES))))))


def test_every_metric_has_a_key_of_its_own_and_a_definition():
    assert len({metric.key for metric in METRICS}) == len(METRICS)
    for metric in METRICS:
        assert metric.heading
        assert metric.definition.endswith(".")


def test_metric_text_has_its_unit():
    with_unit, *_, without = OSPA
    assert (with_unit.text(103.26), without.text(0.0125)) == ("103.3 m", "0.013")


@pytest.mark.parametrize(
    ("metres", "text"),
    [(0.0, "0.0 m"), (1e-9, "0.0 m"), (0.0462, "0.046 m"), (0.4621, "0.46 m"), (0.999, "1.0 m")],
)
def test_metric_text_of_a_short_length_has_two_digits(metres, text):
    assert OSPA[0].text(metres) == text


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (100.0, 25.0, 0.75),
        (100.0, 400.0, -3.0),
        (0.0, 1.0, None),
        (None, 1.0, None),
        (1.0, None, None),
    ],
)
def test_reduction_is_a_share_of_what_was_before(before, after, expected):
    assert reduction(before, after) == expected
