import numpy as np
import pytest

from phd_jdtc_ros.core.association import batches
from phd_jdtc_ros.core.association.batches import affordable_loops, sum_exactly
from phd_jdtc_ros.core.association.clusters import cluster_of_nodes


def graph_of(shapes):
    """Return target, detection, T and M of complete clusters of these shapes, (T, M) each."""
    target, detection, targets, size = [], [], 0, 0
    for rows, columns in shapes:
        t, z = np.divmod(np.arange(rows * columns), columns)
        target.append(targets + t)
        detection.append(size + z)
        targets, size = targets + rows, size + columns
    return np.concatenate(target), np.concatenate(detection), targets, size


def loops_of(shapes):
    graph = graph_of(shapes)
    cluster = cluster_of_nodes(*graph)
    return (*affordable_loops(cluster, cluster[graph[0]], graph[2]), cluster)


def test_loops_do_not_include_trees():
    loops, others, cluster = loops_of([(1, 5), (5, 1), (2, 2), (1, 1)])
    np.testing.assert_array_equal(loops.cluster, cluster[6])
    assert others == 0


def test_loops_of_many_detections_and_few_targets_have_targets_for_columns():
    loops, others, _ = loops_of([(2, 200), (3, 4)])
    assert others == 0
    np.testing.assert_array_equal(loops.columns, [4, 2])
    np.testing.assert_array_equal(loops.rows, [3, 200])
    np.testing.assert_array_equal(loops.swapped, [False, True])


@pytest.mark.parametrize("shape", [(12, 12), (7, 7), (100, 7), (2, 300)])
def test_loops_of_this_size_are_affordable(shape):
    assert loops_of([shape])[1] == 0


@pytest.mark.parametrize("shape", [(14, 14), (60, 60), (5000, 2), (2, 5000), (40, 2000)])
def test_loops_beyond_the_bound_of_a_cluster_are_counted_and_left_out(shape):
    loops, others, _ = loops_of([shape, (2, 2)])
    assert others == 1
    np.testing.assert_array_equal(loops.columns, [2])


def test_loops_beyond_the_bound_of_all_are_the_costliest(monkeypatch):
    monkeypatch.setattr(batches, "MOST_WORK", 2000)
    loops, others, _ = loops_of([(6, 6), (2, 2), (3, 3), (6, 6)])
    np.testing.assert_array_equal(loops.columns, [2, 3])
    assert others == 2


def test_sums_of_a_thousand_clusters_take_a_few_batches(monkeypatch):
    made = []

    def counted(batch):
        made.append(len(batch.rows))
        return exact(batch)

    exact = batches.ExactMarginals
    monkeypatch.setattr(batches, "ExactMarginals", counted)
    target, detection, targets, size = graph_of([(4, 2), (3, 3)] * 500)
    cluster = cluster_of_nodes(target, detection, targets, size)
    loops, _ = affordable_loops(cluster, cluster[target], targets)
    sums = sum_exactly(loops, cluster, target, detection, np.ones(len(target)), targets)
    assert sum(made) == 1000
    assert len(made) < 10
    np.testing.assert_array_equal(np.sort(sums.edge), np.arange(len(target)))
    np.testing.assert_array_equal(np.sort(sums.target), np.arange(targets))


def batches_of(shapes, monkeypatch):
    """Return how many clusters each batch has, and how many columns."""
    made = []

    def counted(batch):
        made.append((len(batch.rows), batch.size))
        return exact(batch)

    exact = batches.ExactMarginals
    monkeypatch.setattr(batches, "ExactMarginals", counted)
    target, detection, targets, size = graph_of(shapes)
    cluster = cluster_of_nodes(target, detection, targets, size)
    loops, _ = affordable_loops(cluster, cluster[target], targets)
    sum_exactly(loops, cluster, target, detection, np.ones(len(target)), targets)
    return made


def test_batches_hold_as_many_clusters_as_fit_the_table(monkeypatch):
    # A table of a cluster of three rows and two columns has 4 * 2 * 4 entries.
    monkeypatch.setattr(batches, "LARGEST_BATCH", 3 * 32)
    made = batches_of([(3, 2)] * 7 + [(3, 3)] * 2, monkeypatch)
    assert made == [(3, 2), (3, 2), (1, 2), (1, 3), (1, 3)]


def test_batches_hold_clusters_with_targets_for_columns_together(monkeypatch):
    assert batches_of([(2, 12)] * 4 + [(3, 2)] * 2, monkeypatch) == [(2, 2), (4, 2)]


def test_loops_of_as_many_detections_as_are_few_keep_them_for_columns():
    few = batches.FEW_DETECTIONS
    loops, _, _ = loops_of([(2, few), (2, few + 1), (few + 1, few + 1)])
    assert sorted(zip(loops.columns, loops.swapped, strict=True)) == [
        (2, True),
        (few, False),
        (few + 1, False),
    ]


@pytest.mark.parametrize(("bound", "left_out"), [("LARGEST_CLUSTER", 1), ("MOST_WORK", 1)])
def test_loops_of_just_the_bound_are_affordable(bound, left_out, monkeypatch):
    # Four edges, and two columns: four states each; with a batch of this size no step is shared.
    monkeypatch.setattr(batches, "LARGEST_BATCH", 1)
    work = 4 * (4 + batches.STEP)
    monkeypatch.setattr(batches, bound, work)
    assert loops_of([(2, 2)])[1] == 0
    monkeypatch.setattr(batches, bound, work - 1)
    assert loops_of([(2, 2)])[1] == left_out


def test_loops_share_the_steps_of_a_batch(monkeypatch):
    # Of the 96 entries of a batch a table of three rows of sums, both ways, and four states has 24.
    monkeypatch.setattr(batches, "LARGEST_BATCH", 96)
    work = 4 * (4 + batches.STEP // 4)
    monkeypatch.setattr(batches, "LARGEST_CLUSTER", work)
    assert loops_of([(2, 2)])[1] == 0
    monkeypatch.setattr(batches, "LARGEST_CLUSTER", work - 1)
    assert loops_of([(2, 2)])[1] == 1


def test_loops_of_equal_cost_are_taken_in_their_order(monkeypatch):
    monkeypatch.setattr(batches, "LARGEST_BATCH", 1)
    monkeypatch.setattr(batches, "MOST_WORK", 25 * 4 * (4 + batches.STEP))
    loops, others, cluster = loops_of([(2, 2), (3, 3)] * 50)
    assert others == 75
    np.testing.assert_array_equal(np.sort(loops.cluster), np.unique(cluster)[:50:2])
