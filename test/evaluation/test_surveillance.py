import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.evaluation.comparison import LabelledPoints
from phd_jdtc_ros.evaluation.distances import confusion_matrix
from phd_jdtc_ros.evaluation.metrics import assign, gospa, ospa, ospa_of_distances
from phd_jdtc_ros.evaluation.tracks import (
    Gap,
    GapFinder,
    Ospa2Accumulator,
    track_distances,
    tracks_of,
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


def scans_of(tracks):
    """Return a list of tracks, each a list of positions or None, scan by scan."""
    scans = []
    for scan in range(len(tracks[0]) if tracks else SCANS):
        seen = [(n, t[scan]) for n, t in enumerate(tracks, start=1) if t[scan] is not None]
        label = np.array([number for number, _ in seen], dtype=np.int64)
        position = np.array([point for _, point in seen], dtype=float).reshape(-1, 2)
        scans.append(LabelledPoints(label, position))
    return scans


def gathered(tracks):
    return tracks_of(scans_of(tracks))


def ospa2(a, b, order):
    return ospa_of_distances(track_distances(a, b, CUTOFF), CUTOFF, order)


def over_time(truth, estimate, window, order):
    """Return the OSPA(2) of every scan's window."""
    newest = Ospa2Accumulator(CUTOFF, order, window)
    pairs = zip(scans_of(truth), scans_of(estimate), strict=True)
    return [newest.add(*pair, None)[0] for pair in pairs]


track_sets = track_lists.map(gathered)


@settings(deadline=None, max_examples=60)
@given(a=point_sets, b=point_sets, order=orders)
def test_gospa_is_the_best_of_all_partial_assignments_symmetric_and_of_its_parts(a, b, order):
    forward, backward = gospa(a, b, CUTOFF, order), gospa(b, a, CUTOFF, order)
    assert forward.distance == pytest.approx(backward.distance, abs=1e-9)
    assert forward.missed - forward.false == backward.false - backward.missed == len(a) - len(b)
    found = gospa(a, b, CUTOFF, order)
    unmatched = CUTOFF**order / 2.0 * (found.missed + found.false)
    expected = found.localization**order + unmatched
    assert found.distance**order == pytest.approx(expected, rel=1e-9, abs=1e-9)
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


def test_gospa_of_worked_examples():
    # One pair 30 apart; the pair at 500 counts as missed and false; one more false one.
    truth = np.array([[0.0, 0.0], [1000.0, 0.0]])
    estimate = np.array([[1000.0, 500.0], [0.0, 30.0], [-900.0, 0.0]])
    found = gospa(truth, estimate, CUTOFF, 2.0)
    assert (found.missed, found.false) == (1, 2)
    assert found.localization == pytest.approx(30.0)
    assert found.distance == pytest.approx(np.sqrt(900.0 + 5000.0 * 3))
    assert gospa(NONE, NONE, CUTOFF, 2.0).distance == 0.0
    found = gospa(NONE, np.zeros((2, 2)), CUTOFF, 2.0)
    assert (found.distance, found.missed, found.false) == (pytest.approx(CUTOFF), 0, 2)


def test_track_distances_average_over_scans_by_label():
    scans = [([7, 3], [[1.0, 2.0], [3.0, 4.0]]), ([], NONE), ([3], [[5.0, 6.0]])]
    found = tracks_of([LabelledPoints(np.array(n, dtype=int), np.array(p)) for n, p in scans])
    none = [np.nan, np.nan]
    expected = [[[3.0, 4.0], none, [5.0, 6.0]], [[1.0, 2.0], none, none]]
    np.testing.assert_array_equal(found, expected)
    one = gathered([[(0, 0), (0, 0), (0, 0), None]])
    other = gathered([[None, (30, 40), (0, 500), None]])
    # Missing: 100; 50; cut at 100; the last scan has neither.
    assert track_distances(one, other, CUTOFF) == pytest.approx(250.0 / 3.0)


@settings(deadline=None, max_examples=40)
@given(a=track_sets, b=track_sets, order=orders)
def test_ospa2_is_zero_to_itself_symmetric_and_bounded_by_the_cutoff(a, b, order):
    assert ospa2(a, a, order).distance == pytest.approx(0.0, abs=1e-9)
    forward, backward = ospa2(a, b, order), ospa2(b, a, order)
    assert forward.distance == pytest.approx(backward.distance, abs=1e-9)
    assert 0.0 <= forward.distance <= CUTOFF * (1.0 + 1e-12)


@settings(deadline=None, max_examples=100)
@given(a=track_sets, b=track_sets, c=track_sets, order=orders)
def test_ospa2_obeys_the_triangle_inequality(a, b, c, order):
    ab, bc, ac = (ospa2(p, q, order).distance for p, q in ((a, b), (b, c), (a, c)))
    assert ac <= ab + bc + 1e-9


@settings(deadline=None, max_examples=40)
@given(a=track_lists, b=track_lists, order=orders)
def test_ospa2_of_one_scan_is_ospa(a, b, order):
    found = over_time(a, b, 1, order)
    pairs = zip(scans_of(a), scans_of(b), strict=True)
    expected = [ospa(t.position, e.position, CUTOFF, order).distance for t, e in pairs]
    assert found == pytest.approx(expected, abs=1e-9)


def test_ospa2_counts_broken_and_swapped_labels():
    # Each half of the broken track is far from the whole one in two of four scans: one is
    # matched at c/2, the other is left over.
    whole = gathered([[(0, 0)] * 4])
    broken = gathered([[(0, 0), (0, 0), None, None], [None, None, (0, 0), (0, 0)]])
    found = ospa2(whole, broken, 1.0)
    assert found.distance == pytest.approx(75.0)
    assert (found.localization, found.cardinality) == (pytest.approx(25.0), pytest.approx(50.0))
    truth = gathered([[(0, 0)] * 4, [(500, 0)] * 4])
    swapped = gathered([[(0, 0), (0, 0), (500, 0), (500, 0)], [(500, 0), (500, 0), (0, 0), (0, 0)]])
    assert ospa2(truth, swapped, 2.0).distance == pytest.approx(50.0)
    assert ospa2(truth, truth, 2.0).distance == 0.0


def test_ospa2_is_of_the_scans_in_the_window_or_the_cutoff():
    whole = [[(0, 0)] * 4]
    broken = [[(0, 0), None, None, None], [None, (0, 0), (0, 0), (0, 0)]]
    assert over_time(whole, broken, 2, 1.0) == pytest.approx([0.0, 75.0, 0.0, 0.0])
    expected = ospa2(gathered(whole), gathered(broken), 2.0).distance
    assert over_time(whole, broken, 4, 2.0)[-1] == pytest.approx(expected)
    empty = gathered([])
    assert ospa2(empty, empty, 2.0).distance == 0.0
    assert ospa2(empty, gathered([[(0, 0)] * SCANS]), 2.0).distance == CUTOFF


def confusion(truth, true_class, estimate, estimated_class, classes):
    pairs = assign(truth, estimate, CUTOFF)
    return confusion_matrix(pairs, np.array(true_class), np.array(estimated_class), classes)


def test_confusion_matrix_counts_pairs_of_its_classes():
    truth = np.array([[0.0, 0.0], [1000.0, 0.0], [2000.0, 0.0], [3000.0, 0.0]])
    estimate = np.array([[1010.0, 0.0], [0.0, 20.0], [9000.0, 0.0], [3000.0, 5.0]])
    found = confusion(truth, [0, 1, 1, 0], estimate, [0, 0, 1, 0], 2)
    assert found.tolist() == [[2, 0, 0], [1, 0, 1], [0, 1, 0]]
    truth = np.array([[0.0, 0.0], [1000.0, 0.0], [2000.0, 0.0]])
    found = confusion(truth, [0, 5, 0], truth, [0, 0, 7], 2)
    assert found.tolist() == [[1, 0, 0], [0, 0, 0], [0, 0, 0]]


@settings(deadline=None, max_examples=40)
@given(a=point_sets, b=point_sets)
def test_confusion_matrix_counts_every_target_and_estimate_once(a, b):
    found = confusion(a, np.arange(len(a)) % 3, b, np.arange(len(b)) % 3, 3)
    assert found[:3].sum() == len(a)
    assert found[:, :3].sum() == len(b)
    assert found[3, 3] == 0


SECOND = 1_000_000_000


def gaps_of(finder, time_s, *targets):
    """Add a scan of targets (label, class, whether paired)."""
    label, number, found = np.array(targets, dtype=np.int64).reshape(-1, 3).T
    return finder.add(round(time_s * SECOND), label, number, found.astype(bool))


def found_like(pattern, interval_s=6.0):
    """Return all gaps of one target that is found where the pattern has 1."""
    finder = GapFinder()
    gaps = []
    for scan, letter in enumerate(pattern):
        gaps += gaps_of(finder, scan * interval_s, (1, 0, letter == "1"))
    return gaps + finder.under_way()


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("", []),
        ("111", []),
        # Between estimates there is an interval more than scans were missed.
        ("101", [(12.0, 1)]),
        ("1001011", [(18.0, 2), (12.0, 1)]),
        # Before the first estimate and after the last one there is not.
        ("01", [(6.0, 1)]),
        ("100", [(12.0, 2)]),
        ("000", [(12.0, 3)]),
    ],
)
def test_gap_finder_finds_the_time_between_estimates(pattern, expected):
    assert [(gap.duration_s, gap.missed) for gap in found_like(pattern)] == expected


def test_gap_finder_follows_each_target_by_its_stamps():
    finder = GapFinder()
    gaps_of(finder, 0.0, (1, 0, True))
    gaps_of(finder, 6.0, (1, 0, False))
    assert gaps_of(finder, 100.0, (1, 0, True)) == [Gap(0, 100.0, 1)]
    finder = GapFinder()
    gaps_of(finder, 0.0, (1, 0, True), (2, 1, False))
    assert gaps_of(finder, 6.0, (2, 1, True), (1, 0, False)) == [Gap(1, 6.0, 1)]
    assert finder.under_way() == [Gap(0, 6.0, 1)]


def test_gap_finder_ends_gaps_of_what_has_gone():
    finder = GapFinder()
    gaps_of(finder, 0.0, (1, 0, True))
    gaps_of(finder, 6.0, (1, 0, False))
    assert gaps_of(finder, 12.0) == [Gap(0, 6.0, 1)]
    # After its return it counts as another target.
    assert gaps_of(finder, 18.0, (1, 0, True)) == []
    finder = GapFinder()
    gaps_of(finder, 60.0, (1, 0, True))
    gaps_of(finder, 66.0, (1, 0, False))
    assert gaps_of(finder, 0.0, (1, 0, True)) == [Gap(0, 6.0, 1)]
    assert finder.under_way() == []
    finder = GapFinder()
    for scan in range(100):
        gaps_of(finder, 6.0 * scan, (scan + 1, 0, scan % 2))
    assert len(finder._targets) == 1
