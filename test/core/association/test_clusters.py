import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from phd_jdtc_ros.core.association.clusters import cluster_of_nodes


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
    found = cluster_of_nodes(target, detection, 80, 120)
    np.testing.assert_array_equal(found, first_nodes(target, detection, 80, 120))


def test_clusters_of_a_long_chain_in_any_order_are_one():
    rng = np.random.default_rng(0)
    link = np.arange(2000)
    target, detection = rng.permutation(1001)[(link + 1) // 2], rng.permutation(1000)[link // 2]
    np.testing.assert_array_equal(cluster_of_nodes(target, detection, 1001, 1000), 0)


def test_clusters_without_detections_are_the_targets():
    none = np.zeros(0, dtype=np.int64)
    np.testing.assert_array_equal(cluster_of_nodes(none, none, 3, 0), [0, 1, 2])
