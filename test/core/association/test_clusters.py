import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from phd_jdtc_ros.core.arrays import contiguous
from phd_jdtc_ros.core.association.clusters import clusters_of, graph_of


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


def test_graph_lists_nodes_by_cluster_with_their_edges():
    # Targets 0 and 3 share detection 2, and target 2 has detections 0 and 3.
    target, detection = np.array([3, 2, 0, 2]), np.array([2, 3, 2, 0])
    order, graph = graph_of(4, 5, target, detection)
    np.testing.assert_array_equal(order, [0, 3, 6, 2, 4, 7])
    np.testing.assert_array_equal(graph.first, [0, 3, 6])
    np.testing.assert_array_equal(graph.middle, [2, 4])
    np.testing.assert_array_equal(order[graph.target], target)
    np.testing.assert_array_equal(order[graph.detection], 4 + detection)
    rng = np.random.default_rng(1)
    target, detection = contiguous(*np.nonzero(rng.random((9, 7)) < 0.3))
    order, graph = graph_of(9, 7, target, detection)
    for node in range(len(order)):
        own = graph.link[graph.start[node] : graph.start[node + 1]]
        expected = np.flatnonzero((graph.target == node) | (graph.detection == node))
        np.testing.assert_array_equal(np.sort(own), expected)
