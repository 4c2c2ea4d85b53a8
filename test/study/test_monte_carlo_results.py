import math
from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import GLOBAL_METRICS, Evaluation
from phd_jdtc_ros.study import results as study_results
from phd_jdtc_ros.study.definition import KINDS, Variant
from phd_jdtc_ros.study.metrics import VALUES
from phd_jdtc_ros.study.results import Mean, Result
from phd_jdtc_ros.study.tasks import Scores, score
from phd_jdtc_ros.study.tracker import simulated_run

# --- scores ---------------------------------------------------------------------------------------


@pytest.fixture
def run(study):
    return simulated_run(study.cases[0].scenario, 0)


def exact(run):
    return [PointSet(truth.position, truth.class_id) for truth in run.truth]


def variant_of(kind, lags=(0,)):
    return Variant(kind, KINDS[kind], {}, ("quiet",), lags)


def test_score_of_the_truth_is_perfect_but_for_wrong_classes(run):
    scores = score(run, {0: exact(run)}, variant_of("gaussian"), 2)
    of = {name: scores.values[0, :, 0, VALUES.index(name)] for name in VALUES}
    assert scores.sets == ("all", "class_0", "class_1")
    for name in ("ospa", "localization", "cardinality", "ospa_p1", "ospa_c300"):
        np.testing.assert_array_equal(of[name], 0.0)
    for name in ("n_true", "n_est", "pairs", "right_class"):
        np.testing.assert_array_equal(of[name], [1, 2, 2, 2, 2, 1])
    wrong = [PointSet(points.position, 0 * points.class_id) for points in exact(run)]
    scores = score(run, {0: wrong}, variant_of("gaussian"), 2)
    pairs, right = (scores.values[0, 1, :, VALUES.index(n)] for n in ("pairs", "right_class"))
    assert pairs.tolist() == [2, 1, 1]
    assert right.tolist() == [1, 1, 0]


def test_score_of_peers_and_missing_lags_is_limited(run):
    scores = score(run, {0: exact(run)}, variant_of("jpda", (0, 3)), 2)
    assert (scores.lags, scores.sets) == ((0,), ("all",))
    assert np.isnan(scores.values[..., VALUES.index("right_class")]).all()
    with pytest.raises(ValueError, match="lags"):
        score(run, {0: exact(run)}, variant_of("jpda", (3,)), 2)


def value(scores, name, key="all"):
    """Return a value over the scans, of lag 0."""
    return scores.values[0, :, scores.sets.index(key), VALUES.index(name)]


@pytest.fixture
def pair(run):
    """A run of two targets a kilometre and more apart, of other classes, one from the third scan
    on; twelve scans."""
    early, late = run.scenario.targets
    early = replace(early, position=(0.0, 0.0), velocity=(0.0, 0.0), first_scan=0, last_scan=11)
    late = replace(late, position=(5e3, 0.0), velocity=(0.0, 0.0), first_scan=2, last_scan=11)
    scenario = replace(run.scenario, scans=12, targets=(early, late))
    return simulated_run(scenario, 0)


def scored(run, *found):
    """Return the scores of estimates (x, class), scan by scan."""
    points = [
        PointSet(
            np.array([[x, 0.0] for x, _ in scan]).reshape(-1, 2),
            np.array([class_id for _, class_id in scan], dtype=int),
        )
        for scan in found
    ]
    return score(run, {0: points}, variant_of("gaussian"), 2)


def test_score_after_5_forgives_young_targets_and_no_false_estimates(pair):
    # The first target is found 10 m off, the other one 200 m off.
    found = scored(pair, *[[(10.0, 0)]] * 2, *[[(5200.0, 1), (10.0, 0)]] * 10)
    expected = [math.nan] * 5 + [10.0] * 2 + [141.598] * 5
    np.testing.assert_allclose(value(found, "ospa_after_5"), expected)
    np.testing.assert_allclose(value(found, "ospa_after_5", "class_0"), [math.nan] * 5 + [10.0] * 7)
    expected = [0.0] * 2 + [math.nan] * 5 + [200.0] * 5
    np.testing.assert_allclose(value(found, "ospa_after_5", "class_1"), expected)
    found = scored(pair, *[[(0.0, 0)]] * 12)
    assert value(found, "ospa_after_5")[5:].tolist() == [0.0] * 2 + [707.107] * 5
    found = scored(pair, *[[(0.0, 0), (-9e3, 0)]] * 12)
    assert value(found, "ospa_after_5")[5:7].tolist() == [707.107] * 2


def test_score_counts_the_classes_that_targets_are_taken_for(pair):
    found = scored(pair, *[[(0.0, 1)]] * 2, *[[(5e3, 1)]] * 10)
    assert found.taken_for[0].sum(axis=0).tolist() == [[0, 2], [0, 10]]
    assert score(pair, {0: exact(pair)}, variant_of("jpda"), 2).taken_for is None
    # The first target in its fourth scan, and the other one in its fifth.
    found = scored(pair, *[[]] * 3, *[[(0.0, 0)]] * 3, *[[(0.0, 0), (5e3, 1)]] * 6)
    assert np.flatnonzero(value(found, "begun")).tolist() == [3, 5]
    assert np.flatnonzero(value(found, "prompt")).tolist() == [3]


def test_figures_of_a_study_are_those_of_the_evaluator(pair):
    rng = np.random.default_rng(1)
    evaluation = Evaluation(2, 1000.0, 2.0)
    tracks = []
    for truth in pair.truth:
        position, class_id = truth.position, truth.class_id
        seen = rng.random(len(position)) < 0.6
        near = position[seen] + rng.normal(0.0, 400.0, (seen.sum(), 2))
        false = rng.uniform(-9e3, 9e3, (rng.integers(0, 2), 2))
        number = len(near) + len(false)
        estimate = PointSet(
            np.concatenate([near, false]),
            rng.integers(0, 2, number),
            rng.permutation(number + 1)[:number],
            covariance=np.tile(2.5e4 * np.eye(2), (number, 1, 1)),
        )
        tracks.append(estimate)
        evaluation.add_truth(truth.stamp_ns, PointSet(position, class_id, truth.track_id))
        evaluation.add_estimates(FILTERED, truth.stamp_ns, estimate)
    live = evaluation.summary()[FILTERED]
    scores = score(pair, {0: tracks}, variant_of("gaussian"), 2)
    values, taken_for = scores.values[None], scores.taken_for[None]
    result = Result(
        "", variant_of("gaussian"), (0,), scores._replace(values=values, taken_for=taken_for)
    )

    assert live["all"]["long_gap_share"] > 0.0
    assert live["all"]["nees_age_0_4"] > 1.0
    assert live["all"]["outside_3_sigma"] > 0.0
    assert result.confusion(0)[0].tolist() == live["all"].pop("confusion")
    for metric in GLOBAL_METRICS:
        del live["all"][metric.key]
    for key, figures in live.items():
        found = {name: result.figure(name, 0, key)[0] for name in figures}
        expected = {name: math.nan if v is None else v for name, v in figures.items()}
        assert found == pytest.approx(expected, abs=0.001, nan_ok=True)


# --- summaries ------------------------------------------------------------------------------------


def test_mean_has_students_interval_of_several_runs():
    mean = Mean.of(np.array([1.0, 2.0, 3.0, np.nan]))
    assert mean.mean == 2.0
    # Of three runs, Student's quantile t(0.975, 2) is 4.3027.
    assert mean.half_width == pytest.approx(4.3027 / math.sqrt(3), rel=1e-4)
    assert Mean.of(np.array([3.0])).as_json() == {"mean": 3.0, "interval_95": None}
    assert Mean.of(np.array([np.nan])).as_json() is None
    assert Mean.of(None).as_json() is None


def result_of(variant, **values):
    """Two lags, two runs, one scan, all targets; `values` of shape (runs, lags)."""
    array = np.zeros((2, 2, 1, 1, len(VALUES)))
    for name, found in values.items():
        array[:, :, 0, 0, VALUES.index(name)] = found
    return Result("quiet", variant, (0, 1), Scores((0, 2), ("all",), np.zeros(1), array))


def test_result_figures_are_of_runs_and_scans_that_have_them():
    result = result_of(variant_of("gaussian"), ospa=[[100.0, 50.0], [40.0, 30.0]])
    np.testing.assert_allclose(result.figure("reduction", 2), [0.5, 0.25])
    assert result.figure("reduction", 0) is None
    result = result_of(variant_of("gaussian"), ospa_after_5=[[10.0, np.nan], [20.0, 30.0]])
    np.testing.assert_array_equal(result.figure("ospa_after_5", 2), [np.nan, 30.0])


def test_result_figures():
    result = result_of(
        variant_of("gaussian"),
        cardinality_abs_error=[[1, 2], [0, 0]],
        pairs=[[1, 2], [2, 0]],
        right_class=[[1, 1], [2, 0]],
    )
    assert result.figure("cardinality_abs_error", 2).tolist() == [2.0, 0.0]
    np.testing.assert_array_equal(result.figure("class_accuracy", 2), [0.5, np.nan])


def test_result_over_time_is_the_figure_of_each_scan(pair):
    scores = scored(pair, *[[(0.0, 1)]] * 2, *[[(0.0, 0), (5e3, 0)]] * 9, [])
    result = Result("", variant_of("gaussian"), (0,), scores._replace(values=scores.values[None]))
    expected = [[0.0] * 2 + [0.5] * 9 + [np.nan]]
    np.testing.assert_array_equal(result.over_time("class_accuracy", 0), expected)
    np.testing.assert_array_equal(
        result.over_time("cardinality_abs_error", 0), [[0.0] * 11 + [2.0]]
    )


def test_summarise_holds_the_confusion_of_each_class(study, pair):
    corrected = study.variants[0]
    scores = scored(pair, *[[(0.0, 1)]] * 3, *[[(0.0, 0), (5e3, 1), (9e3, 0)]] * 9)
    values, taken_for = scores.values[None], scores.taken_for[None]
    result = Result("quiet", corrected, (0,), scores._replace(values=values, taken_for=taken_for))
    found = study_results.summarise(study, [result], [], [])["cases"]["quiet"]["corrected"]["lags"][
        "0"
    ]
    assert found["all"]["confusion"] == [[9.0, 3.0, 0.0], [0.0, 9.0, 1.0], [9.0, 0.0, 0.0]]
    shares = {name: share["mean"] for name, share in found["class_0"]["confusion"].items()}
    assert shares == {"class_0": 0.75, "class_1": 0.25, "missed": 0.0}
    assert found["class_1"]["confusion"]["missed"]["mean"] == pytest.approx(0.1)


@pytest.mark.parametrize(("number", "reached"), [(90.0, True), (110.0, False)])
def test_summarise_judges_goals(study, number, reached):
    corrected, *_, reference = study.variants
    results = [
        result_of(corrected, localization=[[0.0, number]] * 2),
        result_of(reference, localization=[[0.0, 1.0]] * 2),
    ]
    (goal,) = study_results.summarise(study, results, [], [])["goals"]
    assert (goal["value"], goal["goal"], goal["reached"]) == (number, 100.0, reached)


def test_summarise_does_not_judge_what_it_does_not_have(study):
    (goal,) = study_results.summarise(study, [], [], [])["goals"]
    assert (goal["value"], goal["goal"], goal["reached"]) == (None, None, None)


def test_goals_relative_to_another_variant_are_checked_on_the_seeds_of_both(study):
    corrected, *_, reference = study.variants
    more = result_of(corrected, localization=[[0.0, 1000.0], [0.0, 60.0]])
    fewer = replace(result_of(reference, localization=[[0.0, 500.0], [0.0, 0.7]]), seeds=(7, 1))
    (goal,) = study_results.summarise(study, [more, fewer], [], [])["goals"]
    assert (goal["value"], goal["goal"]) == (60.0, pytest.approx(70.0))
