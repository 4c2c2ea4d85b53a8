import numpy as np
import pytest

from phd_jdtc_ros.evaluation.accumulators.identity import IdentitySwitches
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.evaluation import Evaluation

CUTOFF = 100.0


def points(**places):
    """Return points on a line by label: `t1` or `n1` and an x in metres."""
    label = np.array([int(name[1:]) for name in places], dtype=int)
    return LabelledPoints(label, np.array([[x, 0.0] for x in places.values()]).reshape(-1, 2))


def switches(*scans):
    """Return the switches of each scan of (targets, tracks)."""
    counter = IdentitySwitches(CUTOFF)
    return [counter.add(points(**truth), points(**estimate)) for truth, estimate in scans]


BOTH = {"t1": 0.0, "t2": 500.0}


def test_tracks_that_keep_or_return_to_their_targets_do_not_switch():
    assert switches(*[(BOTH, {"n7": 5.0, "n8": 510.0})] * 5) == [0] * 5
    assert switches((BOTH, {"n7": 0.0}), (BOTH, {}), (BOTH, {"n7": 0.0})) == [0, 0, 0]
    assert switches(({"t1": 0.0}, {"n7": 0.0}), ({}, {}), ({"t2": 0.0}, {"n7": 0.0})) == [0] * 3


def test_broken_swapped_and_passed_on_numbers_count():
    assert switches((BOTH, {"n7": 0.0}), (BOTH, {}), *[(BOTH, {"n9": 0.0})] * 3) == [0, 0, 1, 0, 0]
    kept, swapped = {"n7": 0.0, "n8": 500.0}, {"n7": 500.0, "n8": 0.0}

    assert switches((BOTH, kept), (BOTH, swapped), (BOTH, swapped)) == [0, 2, 0]
    assert switches((BOTH, {"n7": 0.0}), (BOTH, {"n7": 500.0})) == [0, 1]
    # Also where its first target no longer exists.
    assert switches(({"t1": 0.0}, {"n7": 0.0}), ({"t2": 0.0}, {"n7": 0.0})) == [0, 1]


def seen(*scans):
    """Return the switches of each scan of (targets, tracks, tracks that coast)."""
    counter = IdentitySwitches(CUTOFF)
    return [
        counter.add(
            points(**truth), points(**estimate), np.array([name in coasting for name in estimate])
        )
        for truth, estimate, coasting in scans
    ]


def test_coasting_tracks_keep_their_targets():
    landed, departs = {"t5": 0.0}, {"t6": 60.0}
    scans = [(landed, {"n7": 0.0}), (departs, {"n7": 5.0}), (departs, {"n8": 60.0})]

    assert switches(*scans) == [0, 1, 1]
    assert seen(*[(*scan, ["n7"] if scan is scans[1] else []) for scan in scans]) == [0, 0, 0]
    # If it takes the other one's detections it does not coast, and has changed its target.
    assert seen(*[(*scan, []) for scan in scans]) == [0, 1, 1]
    kept, swapped = {"n7": 0.0, "n8": 500.0}, {"n7": 500.0, "n8": 0.0}

    assert seen((BOTH, kept, []), (BOTH, kept, ["n7"]), (BOTH, kept, [])) == [0, 0, 0]
    # A swap is counted once the tracks are seen again.
    scans = (BOTH, kept, []), (BOTH, swapped, ["n7", "n8"]), (BOTH, swapped, [])
    assert seen(*scans) == [0, 0, 2]


def test_targets_that_cross_are_no_switch_however_they_are_nearest():
    near = {"t1": 0.0, "t2": 10.0}
    apart = {"t1": 300.0, "t2": -300.0}
    scans = [
        ({"t1": -300.0, "t2": 300.0}, {"n7": -300.0, "n8": 300.0}),
        (near, {"n7": 8.0, "n8": 1.0}),
        (near, {"n7": 1.0, "n8": 8.0}),
        (apart, {"n7": 300.0, "n8": -300.0}),
    ]

    assert switches(*scans) == [0] * 4
    # Tracks that came out of it with the wrong targets have switched.
    assert switches(*scans[:3], (apart, {"n7": -300.0, "n8": 300.0})) == [0, 0, 0, 2]


def test_memory_is_that_of_what_exists_and_can_be_cleared():
    counter = IdentitySwitches(CUTOFF)
    counter.add(points(t1=0.0), points(n7=0.0))
    counter.clear()

    assert counter.add(points(t1=0.0), points(n9=0.0)) == 0
    counter = IdentitySwitches(CUTOFF)
    for number in range(1, 1000):
        counter.add(points(**{f"t{number}": 0.0}), points(**{f"n{number}": 0.0}))

    assert (len(counter._track_of), len(counter._target_of)) == (1, 1)


def points_of(scan, labels):
    return PointSet(np.array([[0.0, 0.0], [5e3, 0.0]]), np.array([0, 1]), np.array(labels))


@pytest.mark.parametrize(
    ("last", "expected"), [([1, 2], 0), ([2, 1], 2), ([1, 3], 1), ([0, 0], None)]
)
def test_evaluation_sums_the_switches_of_a_run(last, expected):
    evaluation = Evaluation(2, 1000.0, 2.0)
    for scan, labels in enumerate(([1, 2], last)):
        evaluation.add_truth(scan, points_of(scan, [4, 5]))
        for source in ("filtered", "smoothed"):
            evaluation.add_estimates(source, scan, points_of(scan, labels))
    summary = evaluation.summary()

    assert summary["filtered"]["all"]["identity_switches"] == expected
    assert summary["identity_switches"] == expected
    assert "identity_switches" not in summary["filtered"]["class_0"]
