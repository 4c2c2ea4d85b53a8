import math

import numpy as np
import pytest

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.true_tracks import LONGEST_INTERPOLATION_S, TrueTracks
from phd_jdtc_ros.simulation.traffic.flight import Flight, Leg

SECOND = 1_000_000_000
CURVED = Flight(0, 1.0, 0.0, (1e4, 5e3), (150.0, 30.0), (Leg(60.0, math.radians(3.0)),))


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
