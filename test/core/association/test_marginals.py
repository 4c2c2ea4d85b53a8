import numpy as np
import pytest
from matchings import enumerated

from phd_jdtc_ros.core.association import batches
from phd_jdtc_ros.core.association.marginals import marginals


def propagated(odds, clutter):
    target, detection = np.nonzero(odds)
    edge, none, _ = marginals(target, detection, odds[target, detection], len(odds), clutter)
    dense = np.zeros_like(odds)
    dense[target, detection] = edge
    return dense, none


@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_exact_where_the_graph_is_a_tree(seed):
    rng = np.random.default_rng(seed)
    # A chain: target t shares one detection with target t + 1, and has one of its own.
    odds = np.zeros((4, 7))
    for t in range(4):
        for z in (2 * t - 1, 2 * t):
            if z >= 0:
                odds[t, z] = rng.exponential(5.0)
    odds[3, 6] = rng.exponential(5.0)
    clutter = rng.uniform(0.1, 2.0, 7)
    edge, none = propagated(odds, clutter)
    exact_edge, exact_none = enumerated(odds, clutter)
    np.testing.assert_allclose(edge, exact_edge, atol=1e-6)
    np.testing.assert_allclose(none, exact_none, atol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 1e4])
@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_exact_in_small_clusters_with_loops(seed, scale):
    rng = np.random.default_rng(seed)
    odds = scale * rng.exponential(2.0, (4, 4))
    odds[rng.random((4, 4)) < 0.2] = 0.0
    clutter = rng.uniform(0.1, 2.0, 4)
    edge, none = propagated(odds, clutter)
    exact_edge, exact_none = enumerated(odds, clutter)
    np.testing.assert_allclose(edge, exact_edge, rtol=1e-12)
    np.testing.assert_allclose(none, exact_none, rtol=1e-12)


@pytest.mark.parametrize("shape", [(2, 15), (3, 12), (5, 8), (8, 8)])
def test_marginals_are_exact_in_clusters_of_many_detections(shape):
    # Few targets with many detections each, and a ring of targets with three detections each.
    rng = np.random.default_rng(sum(shape))
    odds = rng.exponential(2.0, shape)
    if shape[0] > 3:
        target, detection = np.ogrid[: shape[0], : shape[1]]
        odds[(detection - target) % shape[1] > 2] = 0.0
    clutter = rng.uniform(0.1, 2.0, shape[1])
    edge, none = propagated(odds, clutter)
    exact_edge, exact_none = enumerated(odds, clutter)
    np.testing.assert_allclose(edge, exact_edge, rtol=1e-12)
    np.testing.assert_allclose(none, exact_none, rtol=1e-12)


def test_marginals_of_clusters_of_all_sizes_are_those_of_each_alone(monkeypatch):
    rng = np.random.default_rng(6)
    tables = [rng.exponential(2.0, rng.integers(1, 6, 2)) for _ in range(40)]
    tables += [rng.exponential(2.0, (2, 9)), rng.exponential(2.0, (3, 9))]
    ends = np.cumsum([(0, 0), *(odds.shape for odds in tables)], axis=0)
    both = np.zeros(ends[-1])
    for odds, (t, z) in zip(tables, ends, strict=False):
        both[t : t + odds.shape[0], z : z + odds.shape[1]] = odds
    clutter = rng.uniform(0.1, 2.0, len(both.T))
    mixed = rng.permutation(len(both))  # neighbours in a cluster need not be neighbours in number
    for entries in (1, batches.LARGEST_BATCH):
        monkeypatch.setattr(batches, "LARGEST_BATCH", entries)
        edge, none = np.empty_like(both), np.empty(len(both))
        edge[mixed], none[mixed] = propagated(both[mixed], clutter)
        for odds, (t, z) in zip(tables, ends, strict=False):
            own = slice(t, t + odds.shape[0]), slice(z, z + odds.shape[1])
            alone, none_alone = propagated(odds, clutter[own[1]])
            np.testing.assert_allclose(edge[own], alone, rtol=1e-12)
            np.testing.assert_allclose(none[own[0]], none_alone, rtol=1e-12)


def test_marginals_count_the_clusters_with_loops_that_are_not_summed_exactly():
    # Two of the clusters are complete and large, one is complete and small, one is a tree.
    blocks = [(30, 30), (4, 4), (1, 40), (30, 30)]
    odds, start = np.zeros((65, 104)), np.zeros(2, dtype=np.int64)
    for t, z in blocks:
        odds[start[0] : start[0] + t, start[1] : start[1] + z] = 1.0
        start += t, z
    target, detection = np.nonzero(odds)
    found = marginals(target, detection, np.ones(len(target)), 65, np.ones(104))
    assert found.approximate == 2
    few = target < 30
    found = marginals(target[~few], detection[~few], np.ones((~few).sum()), 65, np.ones(104))
    assert found.approximate == 1


@pytest.mark.parametrize("clutter", [0.0, 1e-9, 1.0])
@pytest.mark.parametrize("shape", [(4, 2), (9, 7), (3, 20), (11, 11), (40, 40)])
def test_marginals_of_extreme_odds_are_finite(shape, clutter):
    rng = np.random.default_rng(8)
    target, detection = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    odds = np.where(rng.random(len(target)) < 0.3, 0.0, 1e12 * rng.exponential(1.0, len(target)))
    edge, none, _ = marginals(target, detection, odds, shape[0], np.full(shape[1], clutter))
    assert np.isfinite(edge).all()
    assert (edge[odds == 0.0] == 0.0).all()
    np.testing.assert_allclose(np.bincount(target, edge) + none, 1.0, rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_close_in_large_clusters_with_loops(seed, monkeypatch):
    monkeypatch.setattr(batches, "LARGEST_CLUSTER", 0)
    rng = np.random.default_rng(seed)
    odds = rng.exponential(2.0, (3, 4))
    edge, none = propagated(odds, np.ones(4))
    exact_edge, exact_none = enumerated(odds, np.ones(4))
    assert np.abs(edge - exact_edge).max() < 0.03
    assert np.abs(none - exact_none).max() < 0.03


def test_marginals_of_two_loud_targets_are_not_taken_for_certain(monkeypatch):
    # Without clutter or a miss there are two matchings, one twice as likely as the other.
    odds = 1e7 * np.array([[2.0, 1.0], [1.0, 1.0]])
    edge, _ = propagated(odds, np.full(2, 1e-9))
    np.testing.assert_allclose(edge, [[2 / 3, 1 / 3], [1 / 3, 2 / 3]], rtol=1e-6)
    monkeypatch.setattr(batches, "LARGEST_CLUSTER", 0)
    assert propagated(odds, np.full(2, 1e-9))[0].max() > 0.99


def test_marginals_of_one_cluster_do_not_depend_on_another():
    rng = np.random.default_rng(9)
    odds = np.zeros((5, 5))
    odds[:3, :3], odds[3:, 3:] = rng.exponential(3.0, (3, 3)), rng.exponential(3.0, (2, 2))
    both, none = propagated(odds, np.ones(5))
    first, none_first = propagated(odds[:3, :3], np.ones(3))
    second, none_second = propagated(odds[3:, 3:], np.ones(2))
    np.testing.assert_allclose(both[:3, :3], first, rtol=1e-12)
    np.testing.assert_allclose(both[3:, 3:], second, rtol=1e-12)
    np.testing.assert_allclose(none, np.concatenate([none_first, none_second]), rtol=1e-12)


def test_marginals_of_a_detection_that_two_targets_want_alike_are_even():
    edge, _ = propagated(np.full((2, 1), 1e6), np.ones(1))
    np.testing.assert_allclose(edge, 0.5, atol=1e-3)


@pytest.mark.parametrize("scale", [1.0, 1e6])
@pytest.mark.parametrize("clutter", [1.0, 1e-12, 0.0])
def test_marginals_never_use_a_target_or_a_detection_twice(scale, clutter):
    rng = np.random.default_rng(3)
    odds = scale * rng.exponential(1.0, (6, 5))
    edge, none = propagated(odds, np.full(5, clutter))
    assert np.isfinite(edge).all()
    assert (edge >= 0.0).all()
    np.testing.assert_allclose(edge.sum(axis=1) + none, 1.0, rtol=1e-12)
    assert (edge.sum(axis=0) <= 1.0 + 1e-4).all()


def test_marginals_do_not_depend_on_the_order_of_the_edges():
    rng = np.random.default_rng(4)
    odds = rng.exponential(2.0, (4, 4))
    target, detection = np.nonzero(odds)
    order = rng.permutation(len(target))
    value = odds[target, detection]
    edge, none, _ = marginals(target, detection, value, 4, np.ones(4))
    other, same, _ = marginals(target[order], detection[order], value[order], 4, np.ones(4))
    np.testing.assert_allclose(other, edge[order], rtol=1e-9)
    np.testing.assert_allclose(same, none, rtol=1e-9)


def test_marginals_without_an_edge_leave_every_target_undetected():
    index = np.zeros(0, dtype=np.int64)
    edge, none, _ = marginals(index, index, np.zeros(0), 3, np.ones(2))
    assert len(edge) == 0
    np.testing.assert_array_equal(none, 1.0)
