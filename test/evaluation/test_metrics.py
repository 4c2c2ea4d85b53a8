import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.evaluation.comparison import (
    ALL,
    PairedScan,
    PointSet,
    without_slow,
)
from phd_jdtc_ros.evaluation.metrics import assign, ospa
from phd_jdtc_ros.evaluation.run_scores import Evaluation, RunScores

CUTOFF = 100.0
PLACES = np.array([[0.0, 0.0], [5e3, 0.0], [9e3, 0.0]])
NEAR = 200.0
# A ship that moves, one at anchor, and one at anchor without a track.
TRUTH = PointSet(
    np.array([[0.0, 0.0], [1000.0, 0.0], [5000.0, 0.0]]),
    np.zeros(3, dtype=np.int64),
    np.array([1, 2, 3]),
    np.array([[5.0, 0.0], [0.1, 0.0], [0.0, 0.0]]),
)


coordinate = st.floats(-200.0, 200.0)


point_sets = st.lists(st.tuples(coordinate, coordinate), max_size=5).map(
    lambda points: np.array(points, dtype=float).reshape(-1, 2)
)


orders = st.sampled_from([1.0, 1.5, 2.0, 4.0])


@settings(deadline=None, max_examples=60)
@given(points=point_sets, order=orders, seed=st.integers(0, 100))
def test_ospa_of_a_set_with_itself_is_zero(points, order, seed):
    shuffled = points[np.random.default_rng(seed).permutation(len(points))]
    # The order-p root of rounding errors.
    assert ospa(points, shuffled, CUTOFF, order).distance == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=60)
@given(a=point_sets, b=point_sets, order=orders)
def test_ospa_is_the_best_of_all_assignments_symmetric_and_of_its_parts(a, b, order):
    forward, backward = ospa(a, b, CUTOFF, order), ospa(b, a, CUTOFF, order)
    assert forward.distance == pytest.approx(backward.distance, abs=1e-9)
    assert 0.0 <= forward.distance <= CUTOFF * (1.0 + 1e-12)
    found = ospa(a, b, CUTOFF, order)
    parts = found.localization**order + found.cardinality**order
    assert found.distance**order == pytest.approx(parts, rel=1e-9, abs=1e-9)
    few, many = sorted((a, b), key=len)
    if not len(many):
        return
    best = min(
        sum(
            min(float(np.hypot(*(p - q))), CUTOFF) ** order
            for p, q in zip(few, chosen, strict=True)
        )
        for chosen in itertools.permutations(many, len(few))
    )
    total = best + CUTOFF**order * (len(many) - len(few))
    expected = (total / len(many)) ** (1.0 / order)
    assert ospa(a, b, CUTOFF, order).distance == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(deadline=None, max_examples=150)
@given(a=point_sets, b=point_sets, c=point_sets, order=orders)
def test_ospa_obeys_the_triangle_inequality(a, b, c, order):
    ab, bc, ac = (ospa(p, q, CUTOFF, order).distance for p, q in ((a, b), (b, c), (a, c)))
    assert ac <= ab + bc + 1e-9


def test_ospa_of_worked_examples():
    none = np.zeros((0, 2))
    found = ospa(none, none, CUTOFF, 2.0)
    assert (found.distance, found.localization, found.cardinality) == (0.0, 0.0, 0.0)
    # Distances 30 and 40 for the pairs, one target missed, c = 100, p = 2:
    # sqrt((900 + 1600 + 10000) / 3).
    truth = np.array([[0.0, 0.0], [1000.0, 0.0], [0.0, 1000.0]])
    estimate = np.array([[1000.0, 40.0], [30.0, 0.0]])
    found = ospa(truth, estimate, CUTOFF, 2.0)
    assert found.distance == pytest.approx(np.sqrt(12500.0 / 3.0))
    assert found.localization == pytest.approx(np.sqrt(2500.0 / 3.0))
    assert found.cardinality == pytest.approx(np.sqrt(10000.0 / 3.0))
    found = ospa(np.zeros((1, 2)), np.array([[500.0, 0.0]]), CUTOFF, 1.0)
    assert (found.localization, found.cardinality) == (pytest.approx(CUTOFF), 0.0)


@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("swap", [False, True])
def test_ospa_with_one_empty_set_is_the_cutoff(order, swap):
    sets = (np.zeros((3, 2)), np.zeros((0, 2)))
    found = ospa(*(sets[::-1] if swap else sets), CUTOFF, order)
    assert found.distance == pytest.approx(CUTOFF)
    assert found.localization == 0.0
    assert found.cardinality == pytest.approx(CUTOFF)


def test_assign_pairs_by_the_least_total_distance_below_the_cutoff():
    # Greedy would take (0, 0) at 4 and leave a pair at 14; the best total is 6 + 5.
    truth = np.array([[0.0, 0.0], [10.0, 0.0]])
    estimate = np.array([[5.0, 0.0], [-6.0, 0.0]])
    target, found = assign(truth, estimate, CUTOFF)
    assert sorted(zip(target.tolist(), found.tolist(), strict=True)) == [(0, 1), (1, 0)]
    truth = np.array([[0.0, 0.0], [1000.0, 0.0]])
    estimate = np.array([[100.0, 0.0], [1001.0, 0.0]])
    target, found = assign(truth, estimate, CUTOFF)
    assert (target.tolist(), found.tolist()) == ([1], [1])
    target, found = assign(np.zeros((0, 2)), np.zeros((2, 2)), CUTOFF)
    assert len(target) == len(found) == 0


def points(height):
    return PointSet(PLACES, np.zeros(3, dtype=np.int64), np.arange(1, 4), height=height)


def rms(true, found):
    scores = RunScores(1, 1000.0, 2.0)
    scores.add(PairedScan.of(10**9, points(true), points(found), 1000.0))
    return scores.figures()[ALL]["height_rms"]


def test_height_rms_is_that_of_the_pairs_whose_heights_are_known():
    true = np.array([1000.0, 2000.0, 3000.0])
    assert rms(true, np.array([1003.0, 1996.0, np.nan])) == pytest.approx(np.sqrt(12.5))


@pytest.mark.parametrize("true", [None, np.full(3, np.nan)])
def test_height_rms_has_no_meaning_without_heights(true):
    assert rms(true, np.zeros(3)) is None
    assert rms(np.zeros(3), true) is None


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
