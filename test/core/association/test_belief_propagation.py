import numpy as np
import pytest

from phd_jdtc_ros.core.association import belief_propagation
from phd_jdtc_ros.core.association.belief_propagation import propagate
from phd_jdtc_ros.core.association.clusters import cluster_of_nodes


def clusters_of(rng, shapes, density):
    """Return target, detection, T and M of random clusters, sorted by target."""
    target, detection, targets, size = [], [], 0, 0
    for rows, columns in shapes:
        t, z = np.nonzero(rng.random((rows, columns)) < density)
        target.append(targets + t)
        detection.append(size + z)
        targets, size = targets + rows, size + columns
    return np.concatenate(target), np.concatenate(detection), targets, size


def undropped(target, detection, odds, targets, clutter):
    """Return the edges' marginals by iterations over all edges, every message tested."""
    rival = clutter[detection]
    free = 1.0 / rival
    for _ in range(belief_propagation.ITERATIONS):
        taken = odds * free
        others = np.bincount(target, taken, targets)[target] - taken
        wanted = odds / (1.0 + np.maximum(others, 0.0))
        others = np.bincount(detection, wanted, len(clutter))[detection] - wanted
        before, free = free, 1.0 / (rival + np.maximum(others, 0.0))
        if (np.abs(free - before) <= belief_propagation.TOLERANCE * before).all():
            break
    taken = odds * free
    return taken / (1.0 + np.bincount(target, taken, targets))[target]


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e8])
def test_propagation_drops_only_what_stands_still(scale):
    rng = np.random.default_rng(2)
    shapes = [(1, 1)] * 40 + [(1, 3), (3, 1)] * 30 + [(6, 6)] * 10 + [(30, 30)]
    target, detection, targets, size = clusters_of(rng, shapes, 0.3)
    odds, clutter = scale * rng.exponential(2.0, len(target)), rng.uniform(0.1, 2.0, size)
    cluster = cluster_of_nodes(target, detection, targets, size)[target]
    edge, _ = propagate(target, detection, odds, targets, clutter, cluster)
    expected = undropped(target, detection, odds, targets, clutter)
    np.testing.assert_allclose(edge, expected, rtol=1e-13)


def test_propagation_is_exact_where_the_target_or_the_detection_is_alone():
    # Target 0 has three detections of its own, and targets 1 to 3 compete for the fourth; the
    # dense cluster beside them takes many iterations.
    rng = np.random.default_rng(3)
    t, z = np.nonzero(rng.random((20, 20)) < 0.5)
    target = np.concatenate([[0, 0, 0, 1, 2, 3], 4 + t])
    detection = np.concatenate([[0, 1, 2, 3, 3, 3], 4 + z])
    odds, clutter = rng.exponential(50.0, len(target)), rng.uniform(0.1, 2.0, 24)
    cluster = cluster_of_nodes(target, detection, 24, 24)[target]
    edge, none = propagate(target, detection, odds, 24, clutter, cluster)
    ratio = odds[:6] / clutter[detection[:6]]
    np.testing.assert_allclose(edge[:3], ratio[:3] / (1.0 + ratio[:3].sum()), rtol=1e-14)
    np.testing.assert_allclose(edge[3:6], ratio[3:] / (1.0 + ratio[3:].sum()), rtol=1e-14)
    np.testing.assert_allclose(none[0], 1.0 / (1.0 + ratio[:3].sum()), rtol=1e-14)


@pytest.mark.parametrize("clutter", [1e-9, 1.0])
def test_propagation_of_extreme_odds_is_finite(clutter):
    rng = np.random.default_rng(4)
    target, detection, targets, size = clusters_of(rng, [(30, 30), (1, 4), (4, 1)], 0.5)
    odds = 1e12 * rng.exponential(1.0, len(target))
    odds[rng.random(len(odds)) < 0.2] = 0.0
    cluster = cluster_of_nodes(target, detection, targets, size)[target]
    edge, none = propagate(target, detection, odds, targets, np.full(size, clutter), cluster)
    assert np.isfinite(edge).all()
    total = np.bincount(target, edge, targets) + none
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def loopy(units=1.0):
    """Return the parameters of one cluster with loops, odds and clutter in these units."""
    rng = np.random.default_rng(5)
    target, detection, targets, size = clusters_of(rng, [(9, 9)], 0.6)
    odds, clutter = rng.exponential(5.0, len(target)), rng.uniform(0.1, 2.0, size)
    cluster = cluster_of_nodes(target, detection, targets, size)[target]
    return target, detection, units * odds, targets, units * clutter, cluster


@pytest.mark.parametrize("units", [1e-7, 1e7])
def test_propagation_goes_on_for_as_long_in_all_units(units):
    for one, other in zip(propagate(*loopy()), propagate(*loopy(units)), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_propagation_of_many_edges_takes_fewer_iterations(monkeypatch):
    monkeypatch.setattr(belief_propagation, "ITERATIONS", 6)
    expected = propagate(*loopy())[0]
    monkeypatch.undo()
    edges = len(expected)
    monkeypatch.setattr(belief_propagation, "LEAST_ITERATIONS", 2)
    monkeypatch.setattr(belief_propagation, "MOST_WORK", 7 * edges - 1)
    np.testing.assert_array_equal(propagate(*loopy())[0], expected)
    assert np.abs(expected - undropped(*loopy()[:5])).max() > 1e-4
