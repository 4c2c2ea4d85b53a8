from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from matchings import enumerated

from phd_jdtc_ros.core.association import belief_propagation
from phd_jdtc_ros.core.association import marginals as module
from phd_jdtc_ros.core.association.belief_propagation import propagate, rounds


class Marginals(NamedTuple):
    edge: object
    none: object
    approximate: int


def marginals(target, detection, odds, targets, clutter):
    edges = tuple(map(np.ascontiguousarray, (target, detection, odds, clutter)))
    return Marginals(*module.edge_probabilities(module.MOST_WORK, targets, *edges))


def dense_marginals(odds, clutter):
    target, detection = np.nonzero(odds)
    edge, none, _ = marginals(target, detection, odds[target, detection], len(odds), clutter)
    dense = np.zeros_like(odds)
    dense[target, detection] = edge
    return dense, none


def fractions(values):
    return np.vectorize(Fraction, otypes=[object])(values)


def assert_exact(odds, clutter, rtol=1e-10):
    """Compare the marginals with the sums over all matchings; return them."""
    found = dense_marginals(odds, clutter)
    for own, exact in zip(found, enumerated(odds, clutter), strict=True):
        np.testing.assert_allclose(own, exact, rtol=rtol)
    return found


def random_odds(rng, weights):
    """Return dense odds of up to four targets and detections, some of them zero."""
    shape = tuple(rng.integers(1, 5, 2))
    return weights(shape) * (rng.random(shape) < rng.choice([0.3, 0.6, 1.0]))


@pytest.mark.parametrize("seed", range(6))
def test_marginals_are_those_of_all_matchings_whatever_the_weights(seed):
    rng = np.random.default_rng(seed)
    for _ in range(50):
        odds = random_odds(rng, lambda shape: 10.0 ** rng.uniform(-4.0, 8.0, shape))
        clutter = 10.0 ** rng.uniform(-6.0, 1.0, len(odds.T))
        assert_exact(odds, clutter)
    rng = np.random.default_rng(seed)
    values = [1e-300, 1e-150, 1.0, 1e298, 3e299, 1e300]
    for _ in range(15):
        odds = random_odds(rng, lambda shape: rng.choice(values, shape))
        clutter = rng.choice([1e-6, 1.0], len(odds.T))
        edge, none = dense_marginals(odds, clutter)
        exact_edge, exact_none = enumerated(fractions(odds), fractions(clutter))
        np.testing.assert_allclose(edge, exact_edge.astype(float), atol=1e-10)
        np.testing.assert_allclose(none, exact_none.astype(float), atol=1e-10)


def test_marginals_of_forced_pairs_and_of_no_edges_are_certain():
    # Each target but the first shares its only other detection with the one before.
    odds = np.diag(np.full(6, 1e200)) + np.diag(np.full(5, 1e199), -1)
    edge, none = dense_marginals(odds, np.ones(6))
    np.testing.assert_allclose(edge, np.eye(6), atol=1e-10)
    np.testing.assert_allclose(none, 0.0, atol=1e-10)
    index = np.zeros(0, dtype=np.int64)
    edge, none, _ = marginals(index, index, np.zeros(0), 3, np.ones(2))
    assert len(edge) == 0
    np.testing.assert_array_equal(none, 1.0)


def chain(rng, targets):
    """Return odds of targets that share a detection with the one before and the one after."""
    odds = np.zeros((targets, targets + 1))
    row = np.arange(targets)
    odds[row, row], odds[row, row + 1] = 10.0 ** rng.uniform(-3.0, 6.0, (2, targets))
    return odds


def chain_marginals(odds):
    """Return the marginals of a chain, by matrices from one shared detection to the next."""
    # The matrices lead from [detection t free or taken] to t + 1, by what target t does.
    none = np.array([np.diag([1.0, 0.0])[:, [0, 1]] for _ in odds])
    none[:, 1, 0] = 1.0
    first, second = np.zeros_like(none), np.zeros_like(none)
    row = np.arange(len(odds))
    first[:, 0, 0] = odds[row, row]
    second[:, :, 1] = odds[row, row + 1, None]
    whole = none + first + second
    earlier = [np.array([1.0, 0.0])]
    for step in whole:
        earlier.append(earlier[-1] @ step / (earlier[-1] @ step).sum())
    later = [np.ones(2)]
    for step in whole[::-1]:
        later.append(step @ later[-1] / (step @ later[-1]).sum())
    ways = np.array(
        [
            [earlier[t] @ way[t] @ later[len(odds) - 1 - t] for way in (none, first, second)]
            for t in row
        ]
    )
    return ways / ways.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("targets", [2, 30, 300])
def test_marginals_of_a_long_chain_are_exact(targets):
    rng = np.random.default_rng(targets)
    odds = chain(rng, targets)
    row, order = np.arange(targets), rng.permutation(targets)
    edge, none = np.empty_like(odds), np.empty(targets)
    edge[order], none[order] = dense_marginals(odds[order], np.ones(targets + 1))
    found = np.stack([none, edge[row, row], edge[row, row + 1]], axis=1)
    np.testing.assert_allclose(found, chain_marginals(odds), rtol=1e-10)


@pytest.mark.parametrize("shape", [(2, 15), (3, 12), (5, 8), (8, 8)])
def test_marginals_are_exact_in_clusters_of_many_detections(shape):
    # Few targets with many detections each, and a ring of targets with three detections each.
    rng = np.random.default_rng(sum(shape))
    odds = rng.exponential(2.0, shape)
    if shape[0] > 3:
        target, detection = np.ogrid[: shape[0], : shape[1]]
        odds[(detection - target) % shape[1] > 2] = 0.0
    clutter = rng.uniform(0.1, 2.0, shape[1])
    assert_exact(odds, clutter, rtol=1e-12)


def test_marginals_of_clusters_of_all_sizes_are_those_of_each_alone():
    rng = np.random.default_rng(6)
    tables = [rng.exponential(2.0, rng.integers(1, 6, 2)) for _ in range(40)]
    tables += [rng.exponential(2.0, (2, 9)), rng.exponential(2.0, (3, 9))]
    ends = np.cumsum([(0, 0), *(odds.shape for odds in tables)], axis=0)
    both = np.zeros(ends[-1])
    for odds, (t, z) in zip(tables, ends, strict=False):
        both[t : t + odds.shape[0], z : z + odds.shape[1]] = odds
    clutter = rng.uniform(0.1, 2.0, len(both.T))
    mixed = rng.permutation(len(both))  # Neighbours in a cluster need not be neighbours in number
    edge, none = np.empty_like(both), np.empty(len(both))
    edge[mixed], none[mixed] = dense_marginals(both[mixed], clutter)
    for odds, (t, z) in zip(tables, ends, strict=False):
        own = slice(t, t + odds.shape[0]), slice(z, z + odds.shape[1])
        alone, none_alone = dense_marginals(odds, clutter[own[1]])
        np.testing.assert_allclose(edge[own], alone, rtol=1e-12)
        np.testing.assert_allclose(none[own[0]], none_alone, rtol=1e-12)


def complete(*blocks):
    """Return the arguments of `marginals` for complete clusters of these shapes."""
    odds, start = np.zeros(np.sum(blocks, axis=0)), np.zeros(2, dtype=np.int64)
    for t, z in blocks:
        odds[start[0] : start[0] + t, start[1] : start[1] + z] = 1.0
        start += t, z
    target, detection = np.nonzero(odds)
    return target, detection, np.ones(len(target)), len(odds), np.ones(len(odds.T))


def test_marginals_count_the_clusters_that_take_too_much():
    assert marginals(*complete((30, 30), (4, 4), (1, 40), (30, 30))).approximate == 2
    assert marginals(*complete((4, 4), (1, 40), (30, 30))).approximate == 1
    assert marginals(*complete(*[(10, 10)] * 40)).approximate == 0


@pytest.mark.parametrize("shape", [(12, 12), (100, 7), (7, 100), (2, 5000), (5000, 2), (1, 5000)])
def test_marginals_of_clusters_of_this_size_are_exact(shape):
    found = marginals(*complete(shape))
    assert found.approximate == 0
    np.testing.assert_allclose(found.edge, found.edge[0], rtol=1e-9)


def test_marginals_of_just_the_bound_are_exact(monkeypatch):
    # Two targets and two detections: two edges in each of two steps, with two open nodes.
    monkeypatch.setattr(module, "MOST_WORK", (2 * 4 + 2 * 4) // 2)
    assert marginals(*complete((2, 2))).approximate == 0
    monkeypatch.setattr(module, "MOST_WORK", (2 * 4 + 2 * 4) // 2 - 1)
    assert marginals(*complete((2, 2))).approximate == 1


@pytest.mark.parametrize("clutter", [0.0, 1e-9, 1.0])
@pytest.mark.parametrize("shape", [(4, 2), (9, 7), (3, 20), (11, 11), (40, 40)])
def test_marginals_of_extreme_odds_are_finite(shape, clutter):
    rng = np.random.default_rng(8)
    target, detection = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    odds = np.where(rng.random(len(target)) < 0.3, 0.0, 1e12 * rng.exponential(1.0, len(target)))
    clutter = np.full(shape[1], clutter)
    edge, none, approximate = marginals(target, detection, odds, shape[0], clutter)
    assert np.isfinite(edge).all()
    assert (edge >= 0.0).all()
    assert (edge[odds == 0.0] == 0.0).all()
    np.testing.assert_allclose(np.bincount(target, edge) + none, 1.0, rtol=1e-12)
    # Exact sums use no detection twice either.
    assert approximate or np.bincount(detection, edge).max() <= 1.0 + 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_close_in_large_clusters_with_loops(seed, monkeypatch):
    monkeypatch.setattr(module, "MOST_WORK", 0)
    rng = np.random.default_rng(seed)
    odds = rng.exponential(2.0, (3, 4))
    edge, none = dense_marginals(odds, np.ones(4))
    exact_edge, exact_none = enumerated(odds, np.ones(4))
    assert np.abs(edge - exact_edge).max() < 0.03
    assert np.abs(none - exact_none).max() < 0.03


def test_marginals_of_two_loud_targets_are_not_taken_for_certain(monkeypatch):
    # Without clutter or a miss there are two matchings, one twice as likely as the other.
    odds = 1e7 * np.array([[2.0, 1.0], [1.0, 1.0]])
    edge, _ = dense_marginals(odds, np.full(2, 1e-9))
    np.testing.assert_allclose(edge, [[2 / 3, 1 / 3], [1 / 3, 2 / 3]], rtol=1e-6)
    monkeypatch.setattr(module, "MOST_WORK", 0)
    assert dense_marginals(odds, np.full(2, 1e-9))[0].max() > 0.99


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


def propagated(odds, iterations=200):
    """Return the marginals of dense odds, as (T, M) and (T,)."""
    target, detection = map(np.ascontiguousarray, np.nonzero(odds))
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
    for found, exact in zip(propagated(odds), enumerated(odds, np.ones(8)), strict=True):
        np.testing.assert_allclose(found, exact, atol=1e-6)


def test_propagation_is_exact_where_the_target_or_the_detection_is_alone():
    # Target 0 has three detections of its own, and targets 1 to 3 compete for the fourth.
    odds = np.zeros((4, 4))
    odds[0, :3], odds[1:, 3] = np.random.default_rng(3).exponential(50.0, (2, 3))
    edge, none = propagated(odds)
    np.testing.assert_allclose(edge[0, :3], odds[0, :3] / (1.0 + odds[0].sum()), rtol=1e-14)
    np.testing.assert_allclose(edge[1:, 3], odds[1:, 3] / (1.0 + odds[:, 3].sum()), rtol=1e-14)
    np.testing.assert_allclose(none[0], 1.0 / (1.0 + odds[0].sum()), rtol=1e-14)


def test_propagation_without_edges_or_iterations_ends_at_once():
    none = np.zeros(0, dtype=np.int64)
    edge, missed = propagate(3, 2, none, none, np.zeros(0), 200)
    assert len(edge) == 0
    np.testing.assert_array_equal(missed, 1.0)
    odds = np.random.default_rng(5).exponential(5.0, (9, 9))
    assert np.abs(propagated(odds, 6)[0] - propagated(odds)[0]).max() > 1e-4


@pytest.mark.parametrize("scale", [1e12, 1e80])
def test_propagation_of_extreme_odds_is_finite(scale):
    rng = np.random.default_rng(4)
    odds = scale * rng.exponential(1.0, (30, 30)) * (rng.random((30, 30)) < 0.5)
    edge, none = propagated(odds)
    assert np.isfinite(edge).all()
    np.testing.assert_allclose(edge.sum(axis=1) + none, 1.0, rtol=1e-12)


def test_rounds_are_fewer_for_many_edges():
    most = belief_propagation.MOST_WORK
    assert rounds(0) == rounds(most // 200) == 200
    assert rounds(most // 50) == 50
    assert rounds(most) == 10
