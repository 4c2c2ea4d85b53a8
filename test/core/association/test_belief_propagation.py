import numpy as np
import pytest
from matchings import enumerated

from phd_jdtc_ros.core.arrays import contiguous
from phd_jdtc_ros.core.association import belief_propagation
from phd_jdtc_ros.core.association.belief_propagation import propagate, rounds


def dense(odds, iterations=200):
    """Return the marginals of dense odds, as (T, M) and (T,)."""
    target, detection = contiguous(*np.nonzero(odds))
    edge, none = propagate(*odds.shape, target, detection, odds[target, detection], iterations)
    found = np.zeros_like(odds)
    found[target, detection] = edge
    return found, none


@pytest.mark.parametrize("seed", range(5))
def test_propagation_is_exact_where_the_graph_is_a_tree(seed):
    rng = np.random.default_rng(seed)
    # Target t shares one detection with target t + 1, and has one of its own.
    odds = np.zeros((4, 8))
    for t in range(4):
        odds[t, max(2 * t - 1, 0) : 2 * t + 2] = rng.exponential(5.0, min(2 * t + 2, 3))
    odds[3, 7] = 0.0
    for found, exact in zip(dense(odds), enumerated(odds, np.ones(8)), strict=True):
        np.testing.assert_allclose(found, exact, atol=1e-6)


def test_propagation_is_exact_where_the_target_or_the_detection_is_alone():
    # Target 0 has three detections of its own, and targets 1 to 3 compete for the fourth.
    odds = np.zeros((4, 4))
    odds[0, :3], odds[1:, 3] = np.random.default_rng(3).exponential(50.0, (2, 3))
    edge, none = dense(odds)
    np.testing.assert_allclose(edge[0, :3], odds[0, :3] / (1.0 + odds[0].sum()), rtol=1e-14)
    np.testing.assert_allclose(edge[1:, 3], odds[1:, 3] / (1.0 + odds[:, 3].sum()), rtol=1e-14)
    np.testing.assert_allclose(none[0], 1.0 / (1.0 + odds[0].sum()), rtol=1e-14)


def test_propagation_without_edges_or_iterations_ends_at_once():
    none = np.zeros(0, dtype=np.int64)
    edge, missed = propagate(3, 2, none, none, np.zeros(0), 200)
    assert len(edge) == 0
    np.testing.assert_array_equal(missed, 1.0)
    odds = np.random.default_rng(5).exponential(5.0, (9, 9))
    assert np.abs(dense(odds, 6)[0] - dense(odds)[0]).max() > 1e-4


@pytest.mark.parametrize("scale", [1e12, 1e80])
def test_propagation_of_extreme_odds_is_finite(scale):
    rng = np.random.default_rng(4)
    odds = scale * rng.exponential(1.0, (30, 30)) * (rng.random((30, 30)) < 0.5)
    edge, none = dense(odds)
    assert np.isfinite(edge).all()
    np.testing.assert_allclose(edge.sum(axis=1) + none, 1.0, rtol=1e-12)


def test_rounds_are_fewer_for_many_edges():
    most = belief_propagation.MOST_WORK
    assert rounds(0) == rounds(most // 200) == 200
    assert rounds(most // 50) == 50
    assert rounds(most) == 10
