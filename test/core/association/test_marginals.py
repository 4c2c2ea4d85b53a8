# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import itertools

import numpy as np
import pytest

from phd_jdtc_ros.core.association import marginals as association
from phd_jdtc_ros.core.association.marginals import marginals


def enumerated(odds, clutter):
    """Return (T, M) and (T,) exact marginals of dense odds, event by event."""
    targets, size = odds.shape
    edge, none, total = np.zeros_like(odds), np.zeros(targets), 0.0
    for event in itertools.product(range(-1, size), repeat=targets):
        used = [z for z in event if z >= 0]
        if len(set(used)) < len(used):
            continue
        weight = np.prod([odds[t, z] / clutter[z] for t, z in enumerate(event) if z >= 0])
        total += weight
        for t, z in enumerate(event):
            if z >= 0:
                edge[t, z] += weight
            else:
                none[t] += weight
    return edge / total, none / total


def propagated(odds, clutter):
    target, detection = np.nonzero(odds)
    edge, none = marginals(target, detection, odds[target, detection], len(odds), clutter)
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
    np.testing.assert_allclose(edge, exact_edge, atol=1e-9)
    np.testing.assert_allclose(none, exact_none, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_marginals_are_close_in_large_clusters_with_loops(seed, monkeypatch):
    monkeypatch.setattr(association, "EXACT_DETECTIONS", 0)
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
    monkeypatch.setattr(association, "EXACT_DETECTIONS", 0)
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
    edge, none = marginals(target, detection, value, 4, np.ones(4))
    other, same = marginals(target[order], detection[order], value[order], 4, np.ones(4))
    np.testing.assert_allclose(other, edge[order], rtol=1e-9)
    np.testing.assert_allclose(same, none, rtol=1e-9)


def test_marginals_without_an_edge_leave_every_target_undetected():
    index = np.zeros(0, dtype=np.int64)
    edge, none = marginals(index, index, np.zeros(0), 3, np.ones(2))
    assert len(edge) == 0
    np.testing.assert_array_equal(none, 1.0)
