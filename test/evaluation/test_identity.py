import math

import numpy as np
import pytest

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.evaluation.comparison import (
    LONGEST_INTERPOLATION_S,
    LabelledPoints,
    PointSet,
    TrueTracks,
)
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.simulation.targets import Flight, Leg

CUTOFF = 100.0
BOTH = {"t1": 0.0, "t2": 500.0}
SECOND = 1_000_000_000
CURVED = Flight(0, 1.0, 0.0, (1e4, 5e3), (150.0, 30.0), (Leg(60.0, math.radians(3.0)),))


def points(**places):
    """Return points on a line by label: `t1` or `n1` and an x in metres."""
    label = np.array([int(name[1:]) for name in places], dtype=int)
    return LabelledPoints(label, np.array([[x, 0.0] for x in places.values()]).reshape(-1, 2))


def switches(*scans):
    """Return the switches of each scan of (targets, tracks)."""
    counter = IdentitySwitches(CUTOFF)
    return [counter.add(points(**truth), points(**estimate)) for truth, estimate in scans]


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


def sample(time_s, *flights, labels=None, velocity=True):
    """Return the true targets at a time."""
    state = np.array([flight.states(np.array([time_s]))[0] for flight in flights]).reshape(-1, 5)
    labels = np.arange(1, len(flights) + 1) if labels is None else np.array(labels)
    speeds = state[:, [1, 3]] if velocity else None
    return PointSet(state[:, [0, 2]], np.zeros(len(state), dtype=int), labels, speeds)


def tracks_of(times, *flights, **options):
    tracks = TrueTracks()
    for time in times:
        tracks.add(round(time * SECOND), sample(time, *flights, **options))
    return tracks


def test_the_truth_is_known_at_and_between_its_samples():
    tracks, given = TrueTracks(), sample(1.0, CURVED)
    tracks.add(SECOND, sample(0.5, CURVED))
    tracks.add(SECOND, given)
    assert tracks.at(SECOND) is given
    assert len(tracks) == 1
    tracks = tracks_of([1.0, 2.0], CURVED)
    assert tracks.at(SECOND - 1) is None
    assert tracks.at(2 * SECOND + 1) is None
    assert TrueTracks().at(0) is None


@pytest.mark.parametrize("interval_s", [1.0, 2.0, 4.0])
def test_a_turn_is_interpolated_between_samples(interval_s):
    tracks = tracks_of(np.arange(0.0, 61.0, interval_s), CURVED)
    for time in np.arange(0.1, 59.0, 0.37):
        found = tracks.at(round(time * SECOND))
        exact = CURVED.states(np.array([time]))[0, [0, 2]]
        # The error of a cubic: the interval to the 4th power times the 4th derivative over 384.
        bound = interval_s**4 * 153.0 * math.radians(3.0) ** 3 / 384.0
        assert np.hypot(*(found.position[0] - exact)) <= bound + 1e-6


def test_no_more_samples_are_kept_and_moved_than_asked():
    tracks = tracks_of([0.0, 4.0], CURVED, velocity=False)
    ends = CURVED.states(np.array([0.0, 4.0]))[:, [0, 2]]
    np.testing.assert_allclose(tracks.at(SECOND).position[0], 0.75 * ends[0] + 0.25 * ends[1])
    tracks = TrueTracks(keep=3)
    for second in (5, 1, 9, 7, 8):
        tracks.add(second * SECOND, sample(float(second), CURVED))
    assert len(tracks) == 3
    assert tracks.at(1 * SECOND) is None
    assert tracks.at(round(8.5 * SECOND)) is not None


def test_a_target_is_there_from_its_first_to_its_last_sample():
    tracks = TrueTracks()
    still = Flight(0, 1.0, 0.0, (0.0, 0.0), (0.0, 0.0), (Leg(60.0),))
    for second, labels in enumerate(([7], [3, 7], [7, 3], [3])):
        flights = [CURVED if label == 7 else still for label in labels]
        tracks.add(second * SECOND, sample(float(second), *flights, labels=labels))
    present = [tracks.at(round(t * SECOND)).track_id.tolist() for t in (0.5, 1.5, 2.5)]
    assert present == [[7], [3, 7], [3]]
    # Each keeps its own place, whatever the order of the samples.
    np.testing.assert_allclose(tracks.at(round(1.5 * SECOND)).position[0], [0.0, 0.0])


def test_the_truth_is_not_interpolated_far_apart_or_without_labels():
    near, far = LONGEST_INTERPOLATION_S, LONGEST_INTERPOLATION_S + 0.1
    assert tracks_of([0.0, near], CURVED).at(SECOND) is not None
    assert tracks_of([0.0, far], CURVED).at(SECOND) is None
    assert tracks_of([0.0, 1.0], CURVED, labels=[0]).at(SECOND // 2) is None


# --- evaluation at the estimates' own stamps ------------------------------------------------------
def evaluated(times, truth_first):
    """Return the evaluation of exact estimates at times between the samples of every second."""
    evaluation = Evaluation(1, 1000.0, 2.0)
    truth = [(second * SECOND, sample(float(second), CURVED)) for second in range(20)]
    found = [(source, round(t * SECOND), sample(t, CURVED)) for t in times for source in (
        FILTERED, SMOOTHED)]  # fmt: skip
    if truth_first:
        for entry in truth:
            evaluation.add_truth(*entry)
    scores = [score for entry in found for score in evaluation.add_estimates(*entry)]
    if not truth_first:
        assert scores == []
        scores = [score for entry in truth for score in evaluation.add_truth(*entry)]
    return evaluation, scores


@pytest.mark.parametrize("truth_first", [True, False])
def test_estimates_between_two_samples_are_scored_at_their_own_stamps(truth_first):
    times = [0.4, 3.0, 7.9, 12.123]
    evaluation, scores = evaluated(times, truth_first)
    stamps = [round(t * SECOND) for t in times for _ in range(2)]
    assert [score.stamp_ns for score in scores] == stamps
    summary = evaluation.summary()
    assert summary["scans"] == 4
    assert summary[FILTERED]["all"]["position_rms"] < 1e-3
    assert summary[FILTERED]["all"]["position_detection"] == 1.0


def test_estimates_wait_for_the_truth_and_have_stamps_of_their_own():
    evaluation = Evaluation(1, 1000.0, 2.0)
    evaluation.add_truth(0, sample(0.0, CURVED))
    assert evaluation.add_estimates(FILTERED, SECOND // 2, sample(0.5, CURVED)) == []
    (score,) = evaluation.add_truth(SECOND, sample(1.0, CURVED))
    assert score.stamp_ns == SECOND // 2
    assert evaluation.add_truth(2 * SECOND, sample(2.0, CURVED)) == []
    evaluation, _ = evaluated([0.4, 7.9], True)
    assert evaluation.summary()["truth_scans"] is None
    rare, _ = evaluated([3.0, 7.0, 11.0], True)
    assert rare.summary()["truth_scans"] is None
    # This tracker missed some scans.
    some, _ = evaluated([3.0, 4.0, 5.0, 6.0, 9.0, 10.0], True)
    assert (some.own_stamps, some.summary()["truth_scans"]) == (False, 20)


def test_a_second_pass_scores_stamps_between_samples_again():
    evaluation = Evaluation(1, 1000.0, 2.0)
    for _ in range(2):
        for second in range(10):
            evaluation.add_truth(second * SECOND, sample(float(second), CURVED))
            if second:
                time = second - 0.5
                estimate = round(time * SECOND), sample(time, CURVED)
                evaluation.add_estimates(FILTERED, *estimate)
                # The last smoothed estimates of a pass come after the next one has begun.
                late = (second - 3) % 9 + 0.5
                if second > 3 or evaluation.truth_scans > 10:
                    evaluation.add_estimates(SMOOTHED, round(late * SECOND), sample(late, CURVED))
    assert evaluation.scored == {FILTERED: 18, SMOOTHED: 15}
    assert evaluation.repeated == 0
