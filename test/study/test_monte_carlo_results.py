import math

import numpy as np
import pytest

from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import Mean, Result
from phd_jdtc_ros.study.monte_carlo.definition import Variant
from phd_jdtc_ros.study.monte_carlo.scores import VALUES, Scores, score
from phd_jdtc_ros.study.runs import simulated_run

# --- scores ---------------------------------------------------------------------------------------


@pytest.fixture
def run(study):
    return simulated_run(study.cases[0].scenario, 0)


def exact(run):
    return [PointSet(truth.state[:, list(POSITION)], truth.class_id) for truth in run.truth]


def variant_of(kind, lags=(0,)):
    return Variant(kind, kind, None, {}, ("quiet",), lags)


def test_score_of_the_truth_is_perfect(run):
    scores = score(run, {0: exact(run)}, variant_of("ours"), 2)
    of = {name: scores.values[0, :, 0, VALUES.index(name)] for name in VALUES}

    assert scores.sets == ("all", "class_0", "class_1")
    for name in ("ospa", "localization", "cardinality", "ospa_p1", "ospa_c300"):
        np.testing.assert_array_equal(of[name], 0.0)
    for name in ("n_true", "n_est", "pairs", "right_class"):
        np.testing.assert_array_equal(of[name], [1, 2, 2, 2, 2, 1])


def test_score_counts_wrong_classes_with_the_targets_class(run):
    wrong = [PointSet(points.position, 0 * points.class_id) for points in exact(run)]
    scores = score(run, {0: wrong}, variant_of("ours"), 2)
    pairs, right = (scores.values[0, 1, :, VALUES.index(n)] for n in ("pairs", "right_class"))

    assert pairs.tolist() == [2, 1, 1]
    assert right.tolist() == [1, 1, 0]


def test_score_of_a_peer_has_no_classes(run):
    scores = score(run, {0: exact(run)}, variant_of("jpda", (0, 3)), 2)

    assert (scores.lags, scores.sets) == ((0,), ("all",))
    assert np.isnan(scores.values[..., VALUES.index("right_class")]).all()


def test_score_refuses_a_tracker_without_the_wanted_lags(run):
    with pytest.raises(ValueError, match="lags"):
        score(run, {0: exact(run)}, variant_of("jpda", (3,)), 2)


# --- summaries ------------------------------------------------------------------------------------


def test_mean_has_students_interval():
    mean = Mean.of(np.array([1.0, 2.0, 3.0, np.nan]))

    # t(0.975, 2) = 4.3027
    assert mean.mean == 2.0
    assert mean.half_width == pytest.approx(4.3027 / math.sqrt(3), rel=1e-4)


def test_mean_of_one_run_has_no_interval():
    assert Mean.of(np.array([3.0])).as_json() == {"mean": 3.0, "interval_95": None}
    assert Mean.of(np.array([np.nan])).as_json() is None
    assert Mean.of(None).as_json() is None


def result_of(variant, **values):
    """Two lags, two runs, one scan, all targets; `values` of shape (runs, lags)."""
    array = np.zeros((2, 2, 1, 1, len(VALUES)))
    for name, found in values.items():
        array[:, :, 0, 0, VALUES.index(name)] = found
    return Result("quiet", variant, (0, 1), Scores((0, 2), ("all",), np.zeros(1), array))


def test_result_reduction_is_paired_over_runs():
    result = result_of(variant_of("ours"), ospa=[[100.0, 50.0], [40.0, 30.0]])

    np.testing.assert_allclose(result.figure("reduction", 2), [0.5, 0.25])
    assert result.figure("reduction", 0) is None


def test_result_figures():
    result = result_of(
        variant_of("ours"),
        n_true=[[2, 2], [2, 2]],
        n_est=[[1, 4], [2, 2]],
        pairs=[[1, 2], [2, 0]],
        right_class=[[1, 1], [2, 0]],
    )

    assert result.figure("cardinality_abs_error", 2).tolist() == [2.0, 0.0]
    np.testing.assert_array_equal(result.figure("class_accuracy", 2), [0.5, np.nan])


@pytest.mark.parametrize(("value", "reached"), [(90.0, True), (110.0, False)])
def test_summarise_judges_goals(study, value, reached):
    corrected, *_, reference = study.variants
    results = [
        result_of(corrected, localization=[[0.0, value]] * 2),
        result_of(reference, localization=[[0.0, 1.0]] * 2),
    ]

    (goal,) = monte_carlo.summarise(study, results, [], [])["goals"]

    assert (goal["value"], goal["goal"], goal["reached"]) == (value, 100.0, reached)


def test_summarise_does_not_judge_what_it_does_not_have(study):
    (goal,) = monte_carlo.summarise(study, [], [], [])["goals"]

    assert (goal["value"], goal["goal"], goal["reached"]) == (None, None, None)
