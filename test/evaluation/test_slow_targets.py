import numpy as np
import pytest

from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.true_tracks import without_slow

NEAR = 200.0
# A ship that moves, one at anchor, and one at anchor without a track.
TRUTH = PointSet(
    np.array([[0.0, 0.0], [1000.0, 0.0], [5000.0, 0.0]]),
    np.zeros(3, dtype=np.int64),
    np.array([1, 2, 3]),
    np.array([[5.0, 0.0], [0.1, 0.0], [0.0, 0.0]]),
)


def found(*places):
    """Return estimates at places on the x axis, metres."""
    position = np.array([[x, 0.0] for x in places]).reshape(-1, 2)
    return PointSet(position, np.zeros(len(places), dtype=np.int64), 7 + np.arange(len(places)))


def test_slow_targets_are_left_out_with_the_estimates_of_them():
    truth, estimate = without_slow(TRUTH, found(10.0, 990.0), 2.5, NEAR)

    assert truth.track_id.tolist() == [1]
    assert estimate.track_id.tolist() == [7]


def test_other_estimates_than_those_of_slow_targets_are_still_there():
    _, estimate = without_slow(TRUTH, found(10.0, 3000.0), 2.5, NEAR)

    assert estimate.track_id.tolist() == [7, 8]
    _, estimate = without_slow(TRUTH, found(990.0, 1100.0), 2.5, NEAR)

    assert estimate.track_id.tolist() == [8]


@pytest.mark.parametrize(
    ("truth", "least_speed"), [(TRUTH, 0.0), (PointSet(TRUTH.position, TRUTH.class_id), 2.5)]
)
def test_all_targets_are_kept_without_a_least_speed_or_velocities(truth, least_speed):
    estimate = found(10.0)

    assert without_slow(truth, estimate, least_speed, NEAR) == (truth, estimate)


def test_evaluation_scores_tracked_targets_and_lists_the_rest():
    scores = Evaluation(1, NEAR, 2.0, least_speed=2.5)
    for stamp_ns in (0, 1):
        scores.add_truth(stamp_ns, TRUTH)
        scores.add_estimates(FILTERED, stamp_ns, found(10.0, 990.0))

    summary = scores.summary()

    assert summary[FILTERED]["all"]["ospa"] == pytest.approx(10.0)
    assert summary[FILTERED]["all"]["false"] == 0.0
    assert (summary["least_speed"], summary["slow_targets"]) == (2.5, 2.0)
