import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.metrics import gospa, ospa
from phd_jdtc_ros.core.surveillance import (
    confusion_matrix,
    detected,
    detection_history,
    gap_lengths,
    gaps,
    ospa2,
    ospa2_over_time,
    position_errors,
    position_rms,
    track_distances,
    track_set,
)

CUTOFF = 100.0
SCANS = 4
NONE = np.zeros((0, 2))
coordinate = st.floats(-200.0, 200.0)
point_sets = st.lists(st.tuples(coordinate, coordinate), max_size=5).map(
    lambda points: np.array(points, dtype=float).reshape(-1, 2)
)
orders = st.sampled_from([1.0, 1.5, 2.0, 4.0])
# A track is a position, or none, in each scan, and in one at least.
track = st.lists(
    st.one_of(st.none(), st.tuples(coordinate, coordinate)), min_size=SCANS, max_size=SCANS
).filter(any)
track_lists = st.lists(track, max_size=3)


def gathered(tracks):
    """Return a list of tracks, each a list of positions or None, as a track set."""
    length = len(tracks[0]) if tracks else SCANS
    ids, positions = [], []
    for scan in range(length):
        seen = [(n, t[scan]) for n, t in enumerate(tracks, start=1) if t[scan] is not None]
        ids.append(np.array([number for number, _ in seen], dtype=np.int64))
        positions.append(np.array([point for _, point in seen], dtype=float).reshape(-1, 2))
    return track_set(ids, positions)


track_sets = track_lists.map(gathered)


@settings(deadline=None, max_examples=60)
@given(points=point_sets, order=orders, seed=st.integers(0, 100))
def test_gospa_of_a_set_with_itself_is_zero(points, order, seed):
    shuffled = points[np.random.default_rng(seed).permutation(len(points))]
    found = gospa(points, shuffled, CUTOFF, order)
    assert found.distance == pytest.approx(0.0, abs=1e-9)
    assert (found.missed, found.false) == (0, 0)


@settings(deadline=None, max_examples=60)
@given(a=point_sets, b=point_sets, order=orders)
def test_gospa_is_symmetric_and_swaps_missed_and_false(a, b, order):
    forward, backward = gospa(a, b, CUTOFF, order), gospa(b, a, CUTOFF, order)
    assert forward.distance == pytest.approx(backward.distance, abs=1e-9)
    assert forward.missed - forward.false == backward.false - backward.missed == len(a) - len(b)


@settings(deadline=None, max_examples=150)
@given(a=point_sets, b=point_sets, c=point_sets, order=orders)
def test_gospa_obeys_the_triangle_inequality(a, b, c, order):
    ab, bc, ac = (gospa(p, q, CUTOFF, order).distance for p, q in ((a, b), (b, c), (a, c)))
    assert ac <= ab + bc + 1e-9


@settings(deadline=None, max_examples=60)
@given(a=point_sets, b=point_sets, order=orders)
def test_gospa_is_made_of_its_parts(a, b, order):
    found = gospa(a, b, CUTOFF, order)
    unmatched = CUTOFF**order / 2.0 * (found.missed + found.false)
    expected = found.localization**order + unmatched
    assert found.distance**order == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(deadline=None, max_examples=60)
@given(a=point_sets, b=point_sets, order=orders)
def test_gospa_is_the_best_of_all_partial_assignments(a, b, order):
    best = np.inf
    for pairs in range(min(len(a), len(b), 3) + 1):
        for rows in itertools.combinations(range(len(a)), pairs):
            for columns in itertools.permutations(range(len(b)), pairs):
                apart = np.linalg.norm(a[list(rows)] - b[list(columns)], axis=1)
                left = len(a) + len(b) - 2 * pairs
                best = min(best, (apart**order).sum() + CUTOFF**order / 2.0 * left)
    distance = gospa(a, b, CUTOFF, order).distance
    if min(len(a), len(b)) <= 3:
        assert distance**order == pytest.approx(best, rel=1e-9, abs=1e-9)
    else:
        assert distance**order <= best * (1.0 + 1e-9)


def test_gospa_of_a_worked_example():
    # One pair 30 apart; the pair at 500 counts as missed and false; one more false one.
    truth = np.array([[0.0, 0.0], [1000.0, 0.0]])
    estimate = np.array([[1000.0, 500.0], [0.0, 30.0], [-900.0, 0.0]])
    found = gospa(truth, estimate, CUTOFF, 2.0)
    assert (found.missed, found.false) == (1, 2)
    assert found.localization == pytest.approx(30.0)
    assert found.distance == pytest.approx(np.sqrt(900.0 + 5000.0 * 3))


def test_gospa_of_empty_sets_counts_the_other():
    assert gospa(NONE, NONE, CUTOFF, 2.0).distance == 0.0
    found = gospa(NONE, np.zeros((2, 2)), CUTOFF, 2.0)
    assert (found.distance, found.missed, found.false) == (pytest.approx(CUTOFF), 0, 2)


def test_track_set_gathers_positions_by_label():
    found = track_set(
        [np.array([7, 3]), np.array([], dtype=int), np.array([3])],
        [np.array([[1.0, 2.0], [3.0, 4.0]]), NONE, np.array([[5.0, 6.0]])],
    )
    assert found.track_id.tolist() == [7, 3]
    assert found.exists.tolist() == [[True, False, False], [True, False, True]]
    assert found.position[1].tolist() == [[3.0, 4.0], [0.0, 0.0], [5.0, 6.0]]


def test_track_set_keeps_unlabelled_positions_apart():
    found = track_set([np.array([0, 0]), np.array([0])], [np.zeros((2, 2)), np.zeros((1, 2))])
    assert found.track_id.tolist() == [0, 0, 0]
    assert found.exists.sum(axis=1).tolist() == [1, 1, 1]


def test_track_set_refuses_a_label_twice_in_a_scan():
    with pytest.raises(ValueError, match="scan 1"):
        track_set([np.array([1]), np.array([2, 2])], [np.zeros((1, 2)), np.zeros((2, 2))])


def test_track_set_window_drops_tracks_that_do_not_exist_in_it():
    found = gathered([[(0, 0), None, None, None], [None, (1, 1), (2, 2), None]]).window(1, 3)
    assert found.track_id.tolist() == [2]
    assert found.exists.tolist() == [[True, True]]
    assert found.position.tolist() == [[[1.0, 1.0], [2.0, 2.0]]]


def test_track_distances_average_over_the_scans_in_which_either_exists():
    one = gathered([[(0, 0), (0, 0), (0, 0), None]])
    other = gathered([[None, (30, 40), (0, 500), None]])
    # Missing: 100; 50; cut at 100; the last scan has neither.
    assert track_distances(one, other, CUTOFF, 1.0) == pytest.approx(250.0 / 3.0)
    assert track_distances(one, other, CUTOFF, 2.0) == pytest.approx(np.sqrt(22500.0 / 3.0))


@settings(deadline=None, max_examples=40)
@given(a=track_sets, order=orders, base=orders)
def test_ospa2_of_a_set_with_itself_is_zero(a, order, base):
    assert ospa2(a, a, CUTOFF, order, base).distance == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=40)
@given(a=track_sets, b=track_sets, order=orders, base=orders)
def test_ospa2_is_symmetric_and_bounded_by_the_cutoff(a, b, order, base):
    forward, backward = ospa2(a, b, CUTOFF, order, base), ospa2(b, a, CUTOFF, order, base)
    assert forward.distance == pytest.approx(backward.distance, abs=1e-9)
    assert 0.0 <= forward.distance <= CUTOFF * (1.0 + 1e-12)


@settings(deadline=None, max_examples=100)
@given(a=track_sets, b=track_sets, c=track_sets, order=orders, base=orders)
def test_ospa2_obeys_the_triangle_inequality(a, b, c, order, base):
    ab, bc, ac = (ospa2(p, q, CUTOFF, order, base).distance for p, q in ((a, b), (b, c), (a, c)))
    assert ac <= ab + bc + 1e-9


@settings(deadline=None, max_examples=40)
@given(a=track_lists, b=track_lists, order=orders)
def test_ospa2_over_windows_of_one_scan_is_ospa(a, b, order):
    found = ospa2_over_time(gathered(a), gathered(b), 1, CUTOFF, order)
    for scan in range(SCANS):
        points = [
            np.array([t[scan] for t in tracks if t[scan] is not None], dtype=float).reshape(-1, 2)
            for tracks in (a, b)
        ]
        expected = ospa(*points, CUTOFF, order).distance
        assert found[scan].distance == pytest.approx(expected, abs=1e-9)


def test_ospa2_counts_a_broken_track():
    # Each half of the broken track is far from the whole one in two of four scans: one is
    # matched at c/2, the other is left over.
    whole = gathered([[(0, 0)] * 4])
    broken = gathered([[(0, 0), (0, 0), None, None], [None, None, (0, 0), (0, 0)]])
    found = ospa2(whole, broken, CUTOFF, 1.0)
    assert found.distance == pytest.approx(75.0)
    assert (found.localization, found.cardinality) == (pytest.approx(25.0), pytest.approx(50.0))


def test_ospa2_counts_swapped_labels():
    truth = gathered([[(0, 0)] * 4, [(500, 0)] * 4])
    swapped = gathered([[(0, 0), (0, 0), (500, 0), (500, 0)], [(500, 0), (500, 0), (0, 0), (0, 0)]])
    assert ospa2(truth, swapped, CUTOFF, 2.0).distance == pytest.approx(50.0)
    assert ospa2(truth, truth, CUTOFF, 2.0).distance == 0.0


def test_ospa2_over_time_forgets_what_the_window_has_left():
    whole = gathered([[(0, 0)] * 4])
    broken = gathered([[(0, 0), None, None, None], [None, (0, 0), (0, 0), (0, 0)]])
    found = [o.distance for o in ospa2_over_time(whole, broken, 2, CUTOFF, 1.0)]
    assert found == [pytest.approx(d) for d in (0.0, 75.0, 0.0, 0.0)]


def test_ospa2_of_no_tracks_is_zero_and_of_one_side_the_cutoff():
    empty = gathered([])
    assert ospa2(empty, empty, CUTOFF, 2.0).distance == 0.0
    assert ospa2(empty, gathered([[(0, 0)] * SCANS]), CUTOFF, 2.0).distance == CUTOFF


def test_confusion_matrix_counts_pairs_misses_and_false_ones():
    truth = np.array([[0.0, 0.0], [1000.0, 0.0], [2000.0, 0.0], [3000.0, 0.0]])
    estimate = np.array([[1010.0, 0.0], [0.0, 20.0], [9000.0, 0.0], [3000.0, 5.0]])
    found = confusion_matrix(
        truth, np.array([0, 1, 1, 0]), estimate, np.array([0, 0, 1, 0]), CUTOFF, 2
    )
    assert found.tolist() == [[2, 0, 0], [1, 0, 1], [0, 1, 0]]


@settings(deadline=None, max_examples=40)
@given(a=point_sets, b=point_sets)
def test_confusion_matrix_counts_every_target_and_estimate_once(a, b):
    found = confusion_matrix(a, np.arange(len(a)) % 3, b, np.arange(len(b)) % 3, CUTOFF, 3)
    assert found[:3].sum() == len(a)
    assert found[:, :3].sum() == len(b)
    assert found[3, 3] == 0


def test_position_errors_are_those_of_the_pairs_within_the_cutoff():
    truth = np.array([[0.0, 0.0], [1000.0, 0.0]])
    estimate = np.array([[1000.0, 500.0], [30.0, 40.0]])
    assert position_errors(truth, estimate, CUTOFF).tolist() == [50.0]


def test_position_rms_pools_the_scans():
    truth = [np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 2))]
    estimate = [np.array([[30.0, 0.0]]), NONE, np.array([[0.0, 40.0], [900.0, 0.0]])]
    assert position_rms(truth, estimate, CUTOFF) == pytest.approx(np.sqrt(2500.0 / 2.0))


def test_position_rms_without_a_pair_is_none():
    assert position_rms([], [], CUTOFF) is None
    assert position_rms([np.zeros((1, 2))], [NONE], CUTOFF) is None


def test_detected_gives_an_estimate_to_one_target_only():
    truth = np.array([[0.0, 0.0], [10.0, 0.0], [500.0, 0.0]])
    assert detected(truth, np.array([[2.0, 0.0]]), CUTOFF).tolist() == [True, False, False]
    assert detected(truth, NONE, CUTOFF).tolist() == [False, False, False]
    assert detected(NONE, truth, CUTOFF).tolist() == []


def test_detection_history_follows_each_target_through_its_life():
    here, there = np.array([[0.0, 0.0]]), np.array([[500.0, 0.0]])
    both = np.concatenate([there, here])
    found = detection_history(
        [np.array([1]), np.array([2, 1]), np.array([2])], [here, both, there], [here, there, here],
        CUTOFF,
    )  # fmt: skip
    assert {number: seen.tolist() for number, seen in found.items()} == {
        1: [True, False],
        2: [True, False],
    }


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ("", []),
        ("111", []),
        ("000", [3]),
        ("0110", [1, 1]),
        ("1001011", [2, 1]),
    ],
)
def test_gap_lengths_are_the_runs_without_an_estimate(found, expected):
    assert gap_lengths(np.array([c == "1" for c in found], dtype=bool)).tolist() == expected


def test_gaps_of_a_worked_example():
    # Gaps of 2, 1, 1 and 4 scans, 6 s each; above 10 s are two of the four.
    found = np.array([c == "1" for c in "10011010110000"])
    assert gaps(found, 6.0, 10.0).longest_s == 24.0
    assert gaps(found, 6.0, 10.0).long_share == 0.5
    assert gaps(found, 6.0, 12.0).long_share == 0.25


def test_gaps_without_a_gap_are_zero():
    found = gaps(np.ones(5, dtype=bool), 6.0, 0.0)
    assert (found.longest_s, found.long_share) == (0.0, 0.0)
