import numpy as np
import pytest

from phd_jdtc_ros.evaluation.accumulator import OSPA, Accumulator, Metric, Totals
from phd_jdtc_ros.evaluation.comparison import ALL, PairedScan, PointSet
from phd_jdtc_ros.evaluation.run_scores import (
    ACCUMULATORS,
    GROUPS,
    METRICS,
    VALUES,
    ScanComparer,
    reduction,
)
from phd_jdtc_ros.evaluation.tracks import Gaps


def points(*rows):
    """Return a point set of (x, y, class) rows."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return PointSet(table[:, :2], table[:, 2].astype(int))


def compared(*scans, classes=2):
    """Return the values of the last of some scans, as the last one of a run."""
    comparer = ScanComparer(classes, [each(1000.0, 2.0) for each in ACCUMULATORS])
    for second, (truth, estimate) in enumerate(scans):
        comparer.compare(PairedScan.of(second * 10**10, truth, estimate, 1000.0))
    return comparer.final_values()


@pytest.fixture
def scan():
    """Two targets, one found 50 m off as of the other class, and two false estimates."""
    truth = points((0, 0, 0), (5000, 0, 1))
    return truth, points((30, 40, 1), (-9000, 0, 0), (9000, 0, 0))


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
        "gaps": None,
        "ospa2": None,
        "identity_switches": None,
        "seen_switches": None,
    }
    values = compared(scan)[ALL]
    assert {name: values[name] for name in expected} == expected
    assert tuple(values) == VALUES


def test_gaps_are_of_each_class_and_end_with_the_run():
    truth = PointSet(np.array([[0.0, 0.0], [5e3, 0.0]]), np.array([0, 1]), np.array([1, 2]))
    found, lost = truth.only(np.array([0, 1])), truth.only(np.array([0]))
    values = compared((truth, found), (truth, lost), (truth, lost))
    of_gaps = {key: [each[name] for name in Gaps.names] for key, each in values.items()}
    assert of_gaps == {ALL: [1, 1, 2, 20.0], "class_0": [0, 0, 0, 0.0], "class_1": [1, 1, 2, 20.0]}


def test_classes_have_no_verdict_where_none_are_compared(scan):
    assert compared(scan, classes=0)[ALL]["right_class"] is None
    assert compared(scan)[ALL]["right_class"] == 0


def test_a_metric_needs_nothing_but_its_accumulator():
    class Scans(Accumulator):
        names = ("scans_before",)
        metrics = (Metric("scans_before", "before", "Before.", OSPA),)
        scans = -1

        def update(self, scan):
            self.scans += 1

        def values(self, part):
            return (self.scans,)

    comparer = ScanComparer(1, [Scans(1000.0, 2.0)])
    none = points()
    scans = [PairedScan.of(stamp_ns, none, none, 1000.0) for stamp_ns in (0, 1)]
    values = np.array([[comparer.compare(scan)[ALL]["scans_before"]] for scan in scans])
    assert Scans.metrics[0].of_run(Totals.of(comparer.names, values)) == 0.5


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.key)
def test_every_metric_has_figures_of_several_runs_and_none_of_no_scan(metric):
    runs = Totals.of(VALUES, np.ones((3, 5, len(VALUES))))
    assert np.isfinite(metric.of_run(runs)).tolist() == [True] * 3
    assert np.isnan(metric.of_run(Totals.of(VALUES, np.zeros((0, len(VALUES))))))


def test_metrics_have_keys_definitions_and_units():
    assert len({metric.key for metric in METRICS}) == len(METRICS)
    for metric in METRICS:
        assert metric.heading
        assert metric.definition.endswith(".")
    with_unit, *_, without = GROUPS[OSPA]
    assert (with_unit.text(103.26), without.text(0.0125)) == ("103.3 m", "0.013")


@pytest.mark.parametrize(
    ("metres", "text"),
    [(0.0, "0.0 m"), (1e-9, "0.0 m"), (0.0462, "0.046 m"), (0.4621, "0.46 m"), (0.999, "1.0 m")],
)
def test_metric_text_of_a_short_length_has_two_digits(metres, text):
    assert GROUPS[OSPA][0].text(metres) == text


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
