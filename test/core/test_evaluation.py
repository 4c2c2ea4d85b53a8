import numpy as np
import pytest

from phd_jdtc_ros.core.evaluation import FILTERED, SMOOTHED, Evaluation, PointSet

C = 100.0


def points(*rows):
    """Return a point set of (x, y, class) rows."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return PointSet(table[:, :2], table[:, 2].astype(int))


TRUTH = {1: points((0, 0, 0), (1000, 0, 1)), 2: points((10, 0, 0))}
RUN = {
    # Stamp 1: both found, 30 m and 40 m off, the second of the wrong class.
    (FILTERED, 1): points((30, 0, 0), (1040, 0, 0)),
    # Stamp 2: one found exactly, one false.
    (FILTERED, 2): points((10, 0, 0), (5000, 0, 1)),
    # Smoothed: exact, class right at stamp 1; 20 m off and wrong at stamp 2.
    (SMOOTHED, 1): points((0, 0, 0), (1000, 0, 1)),
    (SMOOTHED, 2): points((30, 0, 1)),
}


def evaluated(truth_first):
    evaluation = Evaluation(classes=2, cutoff=C, order=2.0)
    if truth_first:
        for stamp, truth in TRUTH.items():
            assert evaluation.add_truth(stamp, truth) == []
    returned = [s for key, e in RUN.items() for s in evaluation.add_estimates(*key, e)]
    if not truth_first:
        assert returned == []
        returned = [s for stamp, t in TRUTH.items() for s in evaluation.add_truth(stamp, t)]
    return evaluation, returned


@pytest.mark.parametrize("truth_first", [True, False])
def test_evaluation_returns_every_score_once_it_is_possible(truth_first):
    _, returned = evaluated(truth_first)
    assert sorted((s.source, s.stamp_ns) for s in returned) == sorted(RUN)


def test_evaluation_does_not_depend_on_which_comes_first():
    early, late = evaluated(True)[0], evaluated(False)[0]
    assert early.scores == late.scores
    assert early.summary() == late.summary()


def test_summary_holds_the_means_of_a_run():
    summary = evaluated(True)[0].summary()
    # Filtered: sqrt((900 + 1600) / 2) and sqrt(10000 / 2); smoothed: 0 and 20.
    filtered = (np.sqrt(1250.0) + np.sqrt(5000.0)) / 2.0
    assert summary[FILTERED]["all"]["ospa"] == pytest.approx(filtered)
    assert summary[FILTERED]["all"]["localization"] == pytest.approx(np.sqrt(1250.0) / 2.0)
    assert summary[FILTERED]["all"]["cardinality"] == pytest.approx(np.sqrt(5000.0) / 2.0)
    assert summary[FILTERED]["all"]["cardinality_abs_error"] == pytest.approx(0.5)
    assert summary[SMOOTHED]["all"]["ospa"] == pytest.approx(10.0)
    assert summary["reduction"] == pytest.approx(1.0 - 10.0 / filtered)
    assert summary["class_accuracy"] == pytest.approx(2.0 / 3.0)
    assert (summary["p"], summary["c"], summary["scans"]) == (2.0, C, 2)


def test_summary_scores_each_class_by_itself():
    summary = evaluated(True)[0].summary()
    # Class 1, filtered: missed at stamp 1, a false one at stamp 2: c each.
    assert summary[FILTERED]["class_1"]["ospa"] == pytest.approx(C)
    assert summary[FILTERED]["class_1"]["cardinality_abs_error"] == pytest.approx(1.0)
    # Class 1, smoothed: exact at stamp 1, a false one at stamp 2.
    assert summary[SMOOTHED]["class_1"]["ospa"] == pytest.approx(C / 2.0)


def test_summary_without_data_has_no_figures():
    summary = Evaluation(classes=1, cutoff=C, order=2.0).summary()
    assert summary["reduction"] is None
    assert summary["class_accuracy"] is None
    assert summary["scans"] == 0
    for source in (FILTERED, SMOOTHED):
        assert set(summary[source]) == {"all", "class_0"}
        assert set(summary[source]["all"].values()) == {None}


def test_summary_with_one_source_only_has_no_reduction():
    evaluation = Evaluation(classes=1, cutoff=C, order=2.0)
    evaluation.add_truth(1, points((0, 0, 0)))
    evaluation.add_estimates(FILTERED, 1, points((3, 4, 0)))
    summary = evaluation.summary()
    assert summary[FILTERED]["all"]["ospa"] == pytest.approx(5.0)
    assert summary[SMOOTHED]["all"]["ospa"] is None
    assert summary["reduction"] is None
    assert summary["class_accuracy"] is None
    assert summary["scans"] == 0


def test_summary_of_a_perfect_filter_has_no_reduction():
    evaluation = Evaluation(classes=1, cutoff=C, order=2.0)
    evaluation.add_truth(1, points((0, 0, 0)))
    for source in (FILTERED, SMOOTHED):
        evaluation.add_estimates(source, 1, points((0, 0, 0)))
    assert evaluation.summary()["reduction"] is None


def test_evaluation_scores_an_empty_report():
    evaluation = Evaluation(classes=1, cutoff=C, order=2.0)
    evaluation.add_truth(1, points())
    (score,) = evaluation.add_estimates(SMOOTHED, 1, points())
    assert score.scores["all"].ospa.distance == 0.0
    assert (score.pairs, score.right_class) == (0, 0)


def test_evaluation_without_truth_of_a_stamp_keeps_waiting():
    evaluation = Evaluation(classes=1, cutoff=C, order=2.0)
    assert evaluation.add_estimates(FILTERED, 7, points((0, 0, 0))) == []
    assert evaluation.add_truth(8, points((0, 0, 0))) == []
    assert evaluation.summary()["scans"] == 0
