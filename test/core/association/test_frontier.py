"""Clusters of targets and detections, and the exact sums over their matchings."""

import numpy as np
import pytest
from clusters import banded, graph
from matchings import enumerated
from scipy import sparse
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from phd_jdtc_ros.core.association import planning
from phd_jdtc_ros.core.association.clusters import clusters_of
from phd_jdtc_ros.core.association.frontier import (
    LEAST_RISE,
    SLACK,
    matching_probabilities,
    node_prices,
)
from phd_jdtc_ros.core.association.planning import plan

AMPLE = 1 << 40


def first_nodes(target, detection, targets, size):
    """Return the same by scipy."""
    nodes = targets + size
    graph = sparse.coo_array(
        (np.ones(len(target)), (target, targets + detection)), shape=(nodes, nodes)
    )
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    return first[label]


@pytest.mark.parametrize("edges", [0, 1, 10, 60, 100, 400])
def test_clusters_are_the_connected_components(edges):
    rng = np.random.default_rng(edges)
    target, detection = rng.integers(0, 80, edges), rng.integers(0, 120, edges)
    found = clusters_of(80, 120, target, detection)
    np.testing.assert_array_equal(found, first_nodes(target, detection, 80, 120))


def test_clusters_are_chains_and_lone_targets():
    rng = np.random.default_rng(0)
    link = np.arange(2000)
    target, detection = rng.permutation(1001)[(link + 1) // 2], rng.permutation(1000)[link // 2]
    np.testing.assert_array_equal(clusters_of(1001, 1000, target, detection), 0)
    none = np.zeros(0, dtype=np.int64)
    np.testing.assert_array_equal(clusters_of(3, 0, none, none), [0, 1, 2])


@pytest.mark.parametrize("span", [2, 3, 4])
def test_plan_of_a_long_chain_keeps_few_nodes_open(span):
    odds = banded(np.random.default_rng(span), 400, span, np.ones)
    assert plan(graph(odds)[0], AMPLE).table_size.max() <= 1 << (2 * span - 1)


@pytest.mark.parametrize("shape", [(2, 300), (300, 2)])
def test_plan_opens_the_smaller_side_of_a_cluster(shape):
    assert plan(graph(np.ones(shape))[0], AMPLE).table_size.max() == 1 << 2


def test_plan_leaves_out_clusters_that_take_too_much():
    odds = np.zeros((9, 9))
    odds[:2, :2] = odds[2:7, 2:7] = odds[7:, 7:] = 1.0
    found = plan(graph(odds)[0], 20)
    np.testing.assert_array_equal(np.diff(found.first), [2, 0, 2])
    assert found.edge_start[-1] == 8
    assert not len(plan(graph(np.ones((200, 200)))[0], AMPLE).table_size)


def test_plan_has_no_more_entries_than_there_is_memory_for(monkeypatch):
    # Compiled, it would know the bound already.
    interpreted = getattr(plan, "py_func", plan)
    clusters = graph(np.ones((6, 6)))[0]
    entries = plan(clusters, AMPLE).table_size.sum()
    monkeypatch.setattr(planning, "MOST_ENTRIES", entries)
    assert len(interpreted(clusters, AMPLE).table_size)
    monkeypatch.setattr(planning, "MOST_ENTRIES", entries - 1)
    assert not len(interpreted(clusters, AMPLE).table_size)


@pytest.mark.parametrize("seed", range(5))
def test_matching_probabilities_are_sums_over_all_matchings_with_weights_of_unmatched_nodes(seed):
    rng = np.random.default_rng(seed)
    odds = rng.exponential(1.0, (4, 5)) * (rng.random((4, 5)) < 0.7)
    clusters, target, detection, order = graph(odds)
    free = rng.uniform(0.2, 1.0, len(order))
    edge, none = matching_probabilities(plan(clusters, 1 << 40), odds[target, detection], free)
    of_node = np.ones(9)
    of_node[order] = free
    relative = odds / of_node[:4, None]
    exact_edge, exact_none = enumerated(relative, of_node[4:])
    np.testing.assert_allclose(edge, exact_edge[target, detection], rtol=1e-12)
    _, exact_free = enumerated((odds / of_node[4:]).T, of_node[:4])
    expected = np.concatenate([exact_none, exact_free])[order]
    np.testing.assert_allclose(none, expected, rtol=1e-12)


def test_matching_probabilities_of_a_thousand_targets_neither_overflow_nor_underflow():
    rng = np.random.default_rng(1)
    odds = banded(rng, 1000, 3, lambda count: rng.exponential(1.0, count))
    clusters, target, detection, order = graph(odds)
    for scale in (1e-3, 1.0):
        steps = plan(clusters, 1 << 40)
        edge, none = matching_probabilities(
            steps, odds[target, detection], np.full(len(order), scale)
        )
        assert np.isfinite(edge).all()
        whole = np.bincount(clusters.target, edge, len(order)) + none
        np.testing.assert_allclose(whole[order < 1000], 1.0, rtol=1e-9)


def test_matching_probabilities_of_clusters_without_steps_are_zero():
    clusters, target, _, _ = graph(np.ones((4, 4)))
    edge, none = matching_probabilities(plan(clusters, 0), np.ones(len(target)), np.ones(8))
    assert not edge.any()
    assert not none.any()


def random_odds(seed):
    rng = np.random.default_rng(seed)
    odds = banded(rng, 40, 4, lambda count: 10.0 ** rng.uniform(-300.0, 300.0, count))
    odds[rng.random(odds.shape) < 0.2] = 0.0
    return odds


@pytest.mark.parametrize("seed", range(10))
def test_node_prices_bound_every_edge_near_the_heaviest_matching(seed):
    odds = random_odds(seed)
    clusters, target, detection, _ = graph(odds)
    log_odds = np.log(odds[target, detection])
    price = node_prices(clusters, log_odds)
    assert (price >= 0.0).all()
    excess = log_odds - price[clusters.target] - price[clusters.detection]
    assert excess.max() < 1e-10
    gain = np.log(np.maximum(odds, 1.0))  # Nobody takes a pair that weighs less than none
    heaviest = gain[linear_sum_assignment(gain, maximize=True)].sum()
    count = len(clusters.middle)
    assert heaviest - 1e-6 <= price.sum() <= heaviest + count * SLACK


def test_node_prices_are_found_in_few_bids_and_are_nothing_for_weak_pairs():
    # Two hundred targets want one detection less, and bid against each other.
    clusters = graph(np.ones((200, 199)))[0]
    price = node_prices(clusters, np.full(len(clusters.target), 20.0))
    assert 199 * 20.0 - 1e-6 <= price.sum() <= 199 * 20.0 + 200 * LEAST_RISE
    clusters = graph(np.ones((3, 3)))[0]
    np.testing.assert_array_equal(node_prices(clusters, np.full(9, -5.0)), 0.0)
