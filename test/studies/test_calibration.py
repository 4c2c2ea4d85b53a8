import json

import numpy as np

from phd_jdtc_ros.core.types import Estimates, Truth
from studies.calibration.scores import (
    CLASS_EDGES,
    EXISTENCE_EDGES,
    Reliability,
    matched,
    of_run,
    pooled,
)
from studies.command import main


def estimates(position, weight, class_probability, std=100.0):
    """Return estimates with the same standard deviation along both axes."""
    size = len(position)
    state = np.zeros((size, 5))
    state[:, [0, 2]] = position
    class_probability = np.array(class_probability)
    return Estimates(
        stamp_ns=0,
        lag=0,
        state=state,
        covariance=np.tile(np.eye(5) * std**2, (size, 1, 1)),
        weight=np.array(weight),
        class_probability=class_probability,
        class_id=class_probability.argmax(axis=1),
        track_id=np.arange(1, size + 1),
    )


def targets(position, class_id):
    state = np.zeros((len(position), 5))
    state[:, [0, 2]] = position
    return Truth(0, state, np.arange(1, len(position) + 1), np.array(class_id))


def test_matched_gives_targets_to_the_nearer_within_the_gate():
    found = estimates([[10.0, 0.0], [0.0, 0.0]], [0.9, 0.1], [[1.0, 0.0]] * 2)
    target, estimate, square = matched(targets([[5.0, 0.0]], [0]), found)
    assert (target.tolist(), estimate.tolist()) == ([0], [0])
    np.testing.assert_allclose(square, 0.05**2)
    found = estimates([[601.0, 0.0]], [0.9], [[1.0, 0.0]])
    assert len(matched(targets([[0.0, 0.0]], [0]), found)[0]) == 0


def test_of_run_counts_what_exists_and_whose_class_is_right():
    found = estimates([[0.0, 0.0], [9e3, 0.0]], [0.97, 0.35], [[0.2, 0.8], [1.0, 0.0]])
    scores = of_run([targets([[350.0, 0.0]], [1])], [np.array([True])], [found])
    existence = dict(zip(EXISTENCE_EDGES, scores.existence.right, strict=False))
    assert scores.existence.number.sum() == 2
    assert {edge for edge, right in existence.items() if right} == {0.95}
    assert dict(zip(CLASS_EDGES, scores.target_class.right, strict=False))[0.8] == 1
    np.testing.assert_allclose(scores.errors.outside, [1.0, 0.0])
    np.testing.assert_allclose(scores.errors.nees, [0.5 * 3.5**2, 0.0])


def test_pooled_interval_is_wide_where_a_run_repeats_its_statement():
    """Each of four runs says the same a hundred times, and is always right or never."""
    repeated = Reliability(
        np.full((4, 1), 100.0), np.full((4, 1), 50.0), np.array([[100.0], [0.0], [100.0], [0.0]])
    )
    spread = Reliability(repeated.number, repeated.said, np.full((4, 1), 50.0) + [[1], [-1]] * 2)
    wide, narrow = pooled(repeated), pooled(spread)
    assert (wide.right[0], narrow.right[0]) == (0.5, 0.5)
    assert wide.high[0] - wide.low[0] > 0.6
    np.testing.assert_allclose(narrow.high[0] - narrow.low[0], 0.098, atol=0.001)


def test_study_scores_the_tracker_on_drawn_truth(tmp_path, capsys):
    given = ["--runs", "2", "--seed", "7", "--scans", "30", "--out", str(tmp_path)]
    assert main(["calibration", *given]) == 0
    assert "class probability" in capsys.readouterr().out
    found = json.loads((tmp_path / "calibration.json").read_text())["gaussian"]
    assert sum(found["filtered"]["existence"]["number"]) > 0
    assert all(found[source]["covered"]["pairs"] > 0 for source in ("filtered", "smoothed"))
    assert (tmp_path / "reliability.png").stat().st_size > 1e4
    joined = json.loads((tmp_path / "summary.json").read_text())
    assert len(joined["goals"]) == 6
    assert joined["reliability"]["gaussian"] == found
