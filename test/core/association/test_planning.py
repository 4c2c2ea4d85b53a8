import numpy as np
import pytest
from clusters import banded, graph

from phd_jdtc_ros.core.association import planning
from phd_jdtc_ros.core.association.planning import plan

AMPLE = 1 << 40


def random_graph(seed):
    rng = np.random.default_rng(seed)
    return graph(rng.random((12, 15)) < 0.15)[0]


@pytest.mark.parametrize("seed", range(5))
def test_plan_closes_every_node_once_and_has_a_bit_for_each_open_one(seed):
    clusters = random_graph(seed)
    found = plan(clusters, AMPLE)
    np.testing.assert_array_equal(np.sort(found.edge), np.arange(len(clusters.target)))
    np.testing.assert_array_equal(np.sort(found.node), np.arange(clusters.first[-1]))
    assert found.edge_start[-1] == len(found.edge)
    assert found.node_start[-1] == len(found.node)
    clusters = graph(banded(np.random.default_rng(seed), 12, 3, np.ones))[0]
    found = plan(clusters, AMPLE)
    degree = np.diff(clusters.start)
    opened = []  # by their bits
    for step in range(len(found.table_size)):
        assert found.table_before[step] == 1 << len(opened)
        edges = found.edge[found.edge_start[step] : found.edge_start[step + 1]]
        ends = [{clusters.target[edge], clusters.detection[edge]} for edge in edges]
        taken = min(set.intersection(*ends), key=lambda node: degree[node])
        for at, pair in enumerate(ends, start=found.edge_start[step]):
            opened += sorted(pair - set(opened), key=lambda node: node != taken)
            bits = [1 << opened.index(node) for node in pair]
            assert (found.lower_bit[at], found.upper_bit[at]) == (min(bits), max(bits))
        assert found.table_size[step] == 1 << len(opened)
        closed = slice(found.node_start[step], found.node_start[step + 1])
        for node, bit in zip(found.node[closed], found.node_bit[closed], strict=True):
            assert opened[int(bit).bit_length() - 1] == node
        opened = [node for node in opened if node not in found.node[closed]]
    assert not opened


@pytest.mark.parametrize("span", [2, 3, 4])
def test_plan_of_a_long_chain_keeps_few_nodes_open(span):
    odds = banded(np.random.default_rng(span), 400, span, np.ones)
    assert plan(graph(odds)[0], AMPLE).table_size.max() <= 1 << (2 * span)


@pytest.mark.parametrize("shape", [(2, 300), (300, 2)])
def test_plan_opens_the_smaller_side_of_a_cluster(shape):
    assert plan(graph(np.ones(shape))[0], AMPLE).table_size.max() == 1 << 3


def test_plan_takes_one_cluster_after_the_other():
    odds = np.zeros((6, 6))
    odds[:2, :2] = odds[2:4, 2:4] = odds[4:, 4:] = 1.0
    clusters = graph(odds)[0]
    found = plan(clusters, AMPLE)
    np.testing.assert_array_equal(found.node_start[found.first], clusters.first)
    np.testing.assert_array_equal(found.table_before[found.first[:-1]], 1)


def test_plan_leaves_out_clusters_that_take_too_much():
    odds = np.zeros((9, 9))
    odds[:2, :2] = odds[2:7, 2:7] = odds[7:, 7:] = 1.0
    found = plan(graph(odds)[0], 40)
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
