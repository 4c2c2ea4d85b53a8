import numpy as np
import pytest

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.evaluation.accumulator import Totals, ratio
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.evaluation.tracks import OSPA2_WINDOW

C = 100.0
NAMES = ("a", "b")
# Two runs of three scans; b is missing in one scan of the first run.
VALUES = np.array([[[1.0, 2.0], [3.0, np.nan], [5.0, -4.0]], [[1.0, 8.0], [1.0, -9.0], [4.0, 1.0]]])


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


def test_evaluation_takes_unknown_classes_in_any_order():
    early, late = evaluated(True)[0], evaluated(False)[0]
    assert early.scores == late.scores
    assert early.summary() == late.summary()
    found = run_of((points((0, 0, 7)), points((0, 0, 9)))).summary()[FILTERED]
    assert found["all"]["ospa"] == 0.0
    assert found["all"]["position_detection"] == 1.0
    assert found["all"]["confusion"] == [[0] * 3] * 3


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


def test_summary_scores_each_class_or_has_no_figures():
    summary = evaluated(True)[0].summary()
    # Class 1, filtered: missed at stamp 1, a false one at stamp 2: c each.
    assert summary[FILTERED]["class_1"]["ospa"] == pytest.approx(C)
    assert summary[FILTERED]["class_1"]["cardinality_abs_error"] == pytest.approx(1.0)
    # Class 1, smoothed: exact at stamp 1, a false one at stamp 2.
    assert summary[SMOOTHED]["class_1"]["ospa"] == pytest.approx(C / 2.0)
    summary = Evaluation(classes=1, cutoff=C, order=2.0).summary()
    assert summary["reduction"] is None
    assert summary["class_accuracy"] is None
    assert summary["scans"] == 0
    for source in (FILTERED, SMOOTHED):
        assert set(summary[source]) == {"all", "class_0"}
        assert all(value is None for value in summary[source]["all"].values())


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


def labelled(*rows):
    """Return a point set of (x, y, class, track) rows."""
    table = np.array(rows, dtype=float).reshape(-1, 4)
    return PointSet(table[:, :2], table[:, 2].astype(int), table[:, 3].astype(int))


def run_of(*scans, keep=None, stamps=None):
    """Return the evaluation of filtered scans (truth, estimates), 6 s apart."""
    evaluation = Evaluation(2, C, 2.0, keep)
    for index, (truth, estimate) in enumerate(scans):
        stamp_ns = (stamps[index] if stamps else 6 * index) * 1_000_000_000
        evaluation.add_truth(stamp_ns, truth)
        evaluation.add_estimates(FILTERED, stamp_ns, estimate)
    return evaluation


def test_summary_holds_gospa_confusion_and_scans_of_the_truth():
    found = evaluated(True)[0].summary()[FILTERED]["all"]
    # Stamp 1: 30 m and 40 m; stamp 2: exact, and one false.
    assert found["gospa"] == pytest.approx((50.0 + np.sqrt(C**2 / 2.0)) / 2.0)
    assert found["gospa_localization"] == pytest.approx(25.0)
    assert (found["missed"], found["false"]) == (0.0, 0.5)
    summary = evaluated(True)[0].summary()
    assert summary[FILTERED]["all"]["confusion"] == [[2, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert summary[SMOOTHED]["all"]["confusion"] == [[1, 1, 0], [0, 1, 0], [0, 0, 0]]
    assert "confusion" not in summary[FILTERED]["class_0"]
    evaluation = run_of(*[(points(), points())] * 3)
    for stamp in (18_000_000_000, 24_000_000_000):
        evaluation.add_truth(stamp, points())
    found = evaluation.summary()
    assert (found["truth_scans"], evaluation.scored[FILTERED], found["scans"]) == (5, 3, 0)


def test_summary_counts_positions_found_and_missed():
    found = evaluated(True)[0].summary()[FILTERED]
    assert [found[key]["position_detection"] for key in ("all", "class_0", "class_1")] == [1.0] * 3
    # The root mean square of 30, 40 and 0, and of those of each class.
    assert found["all"]["position_rms"] == pytest.approx(np.sqrt(2500.0 / 3.0))
    assert found["class_0"]["position_rms"] == pytest.approx(np.sqrt(900.0 / 2.0))
    assert found["class_1"]["position_rms"] == pytest.approx(40.0)
    here, there = (0, 0, 0), (1000, 0, 1)
    found = run_of((points(here, there), points(here)), (points(there), points(there)))
    summary = found.summary()[FILTERED]
    assert summary["all"]["position_detection"] == pytest.approx(2.0 / 3.0)
    assert summary["class_0"]["position_detection"] == 1.0
    assert summary["class_1"]["position_detection"] == 0.5


def test_summary_holds_the_gaps_of_each_class():
    one, two, none = (0, 0, 0, 1), (1000, 0, 1, 2), labelled()
    both = labelled(one, two)
    # Target 1: a gap of two scans, then one of one scan to its end; target 2 is always found.
    found = [both, labelled(two), labelled(two), both, labelled(two)]
    summary = run_of(
        *((both, seen) for seen in found), (labelled(two), labelled(two)), (none, none)
    )
    summary = summary.summary()
    first, second = (summary[FILTERED][key] for key in ("class_0", "class_1"))
    assert (first["longest_gap_s"], first["long_gap_share"]) == (18.0, 0.5)
    assert first["long_gap_misses"] == pytest.approx(2.0 / 5.0)
    assert (second["longest_gap_s"], second["long_gap_share"]) == (0.0, 0.0)
    assert summary[FILTERED]["all"]["long_gap_misses"] == pytest.approx(2.0 / 11.0)
    assert summary["long_gap_s"] == 16.4


def test_summary_counts_the_gap_that_has_not_ended():
    one = labelled((0, 0, 0, 1))
    scans = [(one, one), *[(one, labelled())] * 3]
    evaluation = run_of(*scans)
    assert evaluation.summary()[FILTERED]["all"]["longest_gap_s"] == 18.0
    # Reading the summary does not change it.
    assert evaluation.summary() == evaluation.summary()


@pytest.mark.parametrize("truth", [points((0, 0, 0)), labelled((0, 0, 0, 3), (900, 0, 0, 3))])
def test_summary_without_labels_of_the_targets_has_no_gaps(truth):
    found = run_of((truth, points())).summary()[FILTERED]["all"]
    assert found["position_detection"] == 0.0
    for key in ("longest_gap_s", "long_gap_share", "long_gap_misses", "ospa2"):
        assert found[key] is None


def test_summary_holds_ospa2_of_labelled_estimates_since_time_went_back():
    one, renamed = labelled((0, 0, 0, 1)), labelled((0, 0, 0, 9))
    swapped = run_of((one, one), (one, renamed)).summary()
    # First exact; then half of a track is left over, the other half far in one scan of two.
    expected = np.sqrt((50.0**2 + C**2) / 2.0) / 2.0
    assert swapped[FILTERED]["all"]["ospa2"] == pytest.approx(expected)
    assert swapped[SMOOTHED]["all"]["ospa2"] is None
    assert swapped["ospa2_window"] == OSPA2_WINDOW
    one, renamed = labelled((0, 0, 0, 1)), labelled((0, 0, 0, 9))
    found = run_of((one, one), (one, renamed), stamps=[6, 0]).summary()
    assert found[FILTERED]["all"]["ospa2"] == 0.0


ONE = labelled((0, 0, 0, 1))


@pytest.mark.parametrize(
    "estimates",
    [[points((0, 0, 0))], [labelled((0, 0, 0, 0))], [labelled()], [ONE, points((0, 0, 0)), ONE]],
)
def test_summary_has_no_ospa2_unless_all_estimates_are_labelled(estimates):
    found = run_of(*((ONE, each) for each in estimates)).summary()
    assert found[FILTERED]["all"]["ospa2"] is None


def test_evaluation_keeps_the_newest_and_no_more_than_asked():
    one = labelled((0, 0, 0, 1))
    evaluation = run_of(*[(one, one)] * 50, keep=5)
    for index in range(50):
        evaluation.add_estimates(SMOOTHED, -1 - index, one)
    kept = [evaluation.scores[FILTERED], evaluation._truth, evaluation._waiting, evaluation._half]
    assert [len(store) for store in kept] == [5] * 4
    assert list(evaluation.scores[FILTERED]) == [6_000_000_000 * scan for scan in range(45, 50)]
    assert evaluation.scored == {FILTERED: 50, SMOOTHED: 0}
    stamps = [0, 6, 12, 18, 24, 0, 30]
    evaluation = run_of(*[(points(), points())] * 7, keep=5, stamps=stamps)
    expected = [12_000_000_000, 18_000_000_000, 24_000_000_000, 0, 30_000_000_000]
    assert list(evaluation.scores[FILTERED]) == expected


def test_summary_does_not_depend_on_how_much_is_kept():
    rng = np.random.default_rng(3)
    one, two = (0, 0, 0, 1), (1000, 0, 1, 2)
    scans = []
    for _ in range(40):
        seen = [
            (x + rng.normal(0.0, 30.0), y, k, t) for x, y, k, t in (one, two) if rng.random() < 0.7
        ]
        scans.append((labelled(one, two), labelled(*seen)))
    few, all_of_them = run_of(*scans, keep=2).summary(), run_of(*scans).summary()
    assert few[FILTERED]["all"]["longest_gap_s"] > 0.0
    assert few == all_of_them


def test_evaluation_scores_a_stamp_that_comes_again_once():
    one, far = labelled((0, 0, 0, 1)), labelled((50, 0, 0, 1))
    evaluation = run_of((one, one), (far, far), stamps=[6, 6])
    for estimate in (one, far):
        evaluation.add_estimates(SMOOTHED, 7, estimate)
    evaluation.add_truth(7, one)
    found = evaluation.summary()
    assert evaluation.scored == {FILTERED: 1, SMOOTHED: 1}
    assert [found[source]["all"]["ospa"] for source in (FILTERED, SMOOTHED)] == [0.0, 0.0]
    assert evaluation.repeated == 3
    assert evaluation.truth_scans == 2


def test_evaluation_scores_every_pass_of_a_loop_and_what_a_pass_leaves_to_the_next():
    one, passes, last = labelled((0, 0, 0, 1)), 3, 6
    evaluation = Evaluation(2, C, 2.0, keep=20)
    for _ in range(passes):
        for stamp in range(1, last + 1):
            evaluation.add_truth(stamp, one)
            evaluation.add_estimates(FILTERED, stamp, one)
            # Smoothed two scans later: the last two of a pass come after the jump.
            earlier = stamp - 2 if stamp > 2 else stamp - 2 + last
            if stamp > 2 or evaluation.truth_scans > last:
                evaluation.add_estimates(SMOOTHED, earlier, one)
            # A second publisher sends the same.
            evaluation.add_truth(stamp, one)
            evaluation.add_estimates(FILTERED, stamp, one)
    assert evaluation.truth_scans == passes * last
    assert evaluation.scored == {FILTERED: passes * last, SMOOTHED: passes * last - 2}
    assert evaluation.repeated == 2 * passes * last


def test_summary_has_the_share_within_500_m():
    one, two = (0, 0, 0, 1), (1000, 0, 0, 2)
    far = Evaluation(1, 800.0, 2.0)
    found = [labelled((10, 0, 0, 7), (1000, 0, 0, 8)), labelled((10, 0, 0, 9), (1000, 600, 0, 8))]
    for stamp, estimate in enumerate(found):
        far.add_truth(stamp, labelled(one, two))
        far.add_estimates(FILTERED, stamp, estimate)
    figures = far.summary()[FILTERED]["all"]
    assert figures["position_near"] == pytest.approx(0.75)
    assert figures["position_detection"] == 1.0


def test_false_per_scan_counts_estimates_beyond_the_cutoff_of_every_target():
    found = Evaluation(classes=2, cutoff=100.0, order=2.0)
    kind = np.zeros(4, dtype=int)
    # A pair, a second estimate of the same target, one at the cut-off, and one beyond it.
    estimates = np.array([[0.0, 10.0], [0.0, -40.0], [60.0, 80.0], [90.0, 50.0]])
    for stamp in range(2):
        found.add_truth(stamp, PointSet(np.zeros((1, 2)), kind[:1]))
        found.add_estimates("filtered", stamp, PointSet(np.zeros((0, 2)), kind[:0]))
        found.add_estimates("smoothed", stamp, PointSet(estimates, kind))
    found.add_truth(2, PointSet(np.zeros((0, 2)), kind[:0]))
    for source in ("filtered", "smoothed"):
        found.add_estimates(source, 2, PointSet(estimates, kind))
    summary = found.summary()
    assert summary["false_per_scan"] == pytest.approx((1 + 1 + 4) / 3)
    assert summary["smoothed"]["all"]["false_per_scan"] == summary["false_per_scan"]
    assert summary["filtered"]["all"]["false_per_scan"] == pytest.approx(4 / 3)
    assert summary["smoothed"]["all"]["false"] == pytest.approx((3 + 3 + 4) / 3)


@pytest.fixture
def totals():
    return Totals.of(NAMES, VALUES)


def test_totals_are_of_each_run_with_means_of_the_scans_that_have_the_value(totals):
    np.testing.assert_array_equal(totals.sum("a"), [9.0, 6.0])
    np.testing.assert_array_equal(totals.mean("a"), [3.0, 2.0])
    np.testing.assert_array_equal(totals.maximum("a"), [5.0, 4.0])
    np.testing.assert_array_equal(totals.mean("b"), [-1.0, 0.0])
    np.testing.assert_array_equal(totals.sum("b"), [np.nan, 0.0])
    np.testing.assert_array_equal(totals.maximum("b"), [np.nan, 8.0])


def test_totals_add_up(totals):
    parts = [Totals.of(NAMES, VALUES[:, scan : scan + 1]) for scan in range(3)]
    together = parts[0].plus(parts[1]).plus(parts[2])
    assert together.scans == 3
    for name in NAMES:
        for figure in (Totals.mean, Totals.sum, Totals.maximum):
            np.testing.assert_array_equal(figure(together, name), figure(totals, name))


def test_totals_of_no_scan_and_ratios_to_nothing_are_not_known():
    none = Totals.of(NAMES, np.zeros((0, 2)))
    assert none.sum("a") == 0.0
    assert np.isnan(none.mean("a"))
    assert np.isnan(none.maximum("a"))
    np.testing.assert_array_equal(ratio(np.array([1.0, 0.0]), np.array([4, 0])), [0.25, np.nan])
