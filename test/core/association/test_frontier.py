import numpy as np
import pytest
from clusters import banded, graph
from matchings import enumerated
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.core.association import frontier
from phd_jdtc_ros.core.association.frontier import (
    LEAST_RISE,
    SLACK,
    matching_probabilities,
    node_prices,
)
from phd_jdtc_ros.core.association.planning import plan


def bits(size, count):
    """Return all tuples of different bits of a table, ascending."""
    every = [1 << place for place in range(size.bit_length() - 1)]
    return (
        [(bit,) for bit in every] if count == 1 else [(a, b) for b in every for a in every if a < b]
    )


def corners(table, lower, upper):
    """Return views of the entries with neither of two nodes taken, and of those with both."""
    of_both = table.reshape(-1, 2, upper // (2 * lower), 2, lower)
    return of_both[:, 0, :, 0], of_both[:, 1, :, 1]


@pytest.mark.parametrize("bits", bits(16, 2))
def test_edge_goes_from_neither_node_taken_to_both(bits):
    table, later = np.random.default_rng(0).random((2, 16))
    neither, both = corners(table, *bits)
    expected = both + 0.37 * neither
    frontier._add_edge(table, *bits, 0.37)
    np.testing.assert_allclose(both, expected, rtol=1e-14)
    before, after = corners(later, *bits)
    share = 0.37 * after
    expected = before + share
    given = frontier._add_edge_backward(table, later, *bits, 0.37)
    assert given == pytest.approx((neither * share).sum(), rel=1e-14)
    np.testing.assert_allclose(before, expected, rtol=1e-14)


@pytest.mark.parametrize("bit", [1, 2, 4, 8])
def test_node_is_closed_and_opened_again_in_its_place(bit):
    values, later = np.random.default_rng(1).random((2, 16))
    halves = values.reshape(-1, 2, bit)
    room = np.append(values, np.zeros(16))
    found = frontier._close_node(room[:16], bit, 0.37, room)
    assert np.shares_memory(found, room)
    expected = (0.37 * halves[:, 0] + halves[:, 1]).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    room = np.append(values, np.zeros(16))
    found = frontier._reopen_node(room[:16], bit, 0.37, room)
    part = values.reshape(-1, bit)
    np.testing.assert_allclose(found, np.stack([0.37 * part, part], axis=1).ravel(), rtol=1e-14)
    share = (halves[:, 0] * later.reshape(-1, 2, bit)[:, 0]).sum()
    assert frontier._unmatched_probability(values, later, bit) == pytest.approx(share, rel=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_matching_probabilities_are_sums_over_all_matchings_with_weights_of_unmatched_nodes(
    seed,
):
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
    gain = np.log(np.maximum(odds, 1.0))  # nobody takes a pair that weighs less than none
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
