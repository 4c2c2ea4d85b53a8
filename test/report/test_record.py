import estimate_sets
import numpy as np
import pytest
from estimate_sets import states

from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.report.record import Record


def truth(stamp_ns, rows, classes):
    number = np.arange(1, len(rows) + 1)
    return Truth(stamp_ns, states(rows), number, np.array(classes, dtype=int))


def estimates(stamp_ns, rows, classes):
    return estimate_sets.estimates(
        states(rows),
        np.zeros((5, 5)),
        stamp_ns=stamp_ns,
        class_probability=np.full((len(rows), 2), 0.5),
        class_id=np.array(classes, dtype=int),
    )


@pytest.fixture
def run():
    return Record(
        truth=(truth(1, [[0, 0], [5e3, 0]], [0, 1]), truth(2, [[0, 0]], [0])),
        plots=(),
        filtered=(estimates(1, [[30, 40]], [0]), estimates(2, [[0, 60]], [1])),
        smoothed=(estimates(1, [[0, 30], [5e3, 40]], [0, 0]),),
        classes=2,
        step_ms=np.zeros(0),
    )


def test_evaluate_scores_every_stamp_that_has_both(run):
    evaluation = run.evaluate(1000.0, 2.0)
    scored = {source: list(scores) for source, scores in evaluation.scores.items()}
    assert scored == {"filtered": [1, 2], "smoothed": [1]}


def test_evaluate_scores_positions_and_classes(run):
    evaluation = run.evaluate(1000.0, 2.0)
    first = evaluation.scores["filtered"][1].values
    assert first["all"]["ospa"] == pytest.approx(np.sqrt((50.0**2 + 1000.0**2) / 2))
    assert first["class_0"]["ospa"] == pytest.approx(50.0)
    assert first["class_1"]["ospa"] == pytest.approx(1000.0)
    second = evaluation.scores["filtered"][2].values
    assert second["all"]["ospa"] == pytest.approx(60.0)
    assert (second["class_0"]["n_true"], second["class_0"]["n_est"]) == (1, 0)
    smoothed = evaluation.scores["smoothed"][1].values["all"]
    assert smoothed["ospa"] == pytest.approx(np.sqrt((30.0**2 + 40.0**2) / 2))
    assert (smoothed["pairs"], smoothed["right_class"]) == (2, 1)


def test_evaluate_passes_cutoff_and_order_on(run):
    evaluation = run.evaluate(35.0, 1.0)
    assert (evaluation.cutoff, evaluation.order) == (35.0, 1.0)
    first = evaluation.scores["smoothed"][1].values["all"]["ospa"]
    assert first == pytest.approx((30.0 + 35.0) / 2)


def test_evaluate_without_truth_scores_nothing(run):
    blind = Record(**{**vars(run), "truth": ()})
    assert blind.evaluate(1000.0, 2.0).summary()["scans"] == 0
