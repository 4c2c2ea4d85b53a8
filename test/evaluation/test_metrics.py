import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.evaluation.metrics import assign, ospa

CUTOFF = 100.0
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
