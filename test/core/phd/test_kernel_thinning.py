"""Thinning of the backward kernel's rows."""

from dataclasses import replace

import numpy as np
import pytest
from paper_room import particles, small
from scenes import gaussian_cloud

from phd_jdtc_ros.core.phd import kernel
from phd_jdtc_ros.core.targets.motion import sample

COUNT = 600


def pairs_of(counts, seed=0):
    """Return rows with the given numbers of pairs, of unequal kernel and weight."""
    rng = np.random.default_rng(seed)
    row = np.repeat(np.flatnonzero(counts), np.array(counts)[np.flatnonzero(counts)])
    column = np.concatenate([rng.permutation(COUNT)[:count] for count in counts])
    weight = rng.uniform(0.5, 1.5, COUNT) / COUNT
    return row, column, rng.exponential(1.0, len(row)), weight


def test_thin_leaves_short_rows_alone():
    row, column, value, weight = pairs_of([kernel.MAX_PAIRS_PER_ROW, 0, 3])
    kept = kernel.thin((row, column, value), weight[column])
    for found, given in zip(kept, (row, column, value), strict=True):
        np.testing.assert_array_equal(found, given)


def test_thin_keeps_the_sum_of_every_row_in_few_pairs():
    row, column, value, weight = pairs_of([500, 4, 0, 90])
    kept_row, kept_column, kept_value = kernel.thin((row, column, value), weight[column])
    before = np.bincount(row, value * weight[column])
    np.testing.assert_allclose(
        np.bincount(kept_row, kept_value * weight[kept_column]), before, rtol=1e-12
    )
    assert np.bincount(kept_row).max() <= kernel.MAX_PAIRS_PER_ROW
    few, kept_few = row == 1, kept_row == 1
    np.testing.assert_array_equal(kept_value[kept_few], value[few])


def test_thin_is_fair_over_many_rows():
    # All rows have the same pairs; only the offset of the comb differs from row to row.
    rows = 2000
    _, column, value, weight = pairs_of([200])
    row = np.repeat(np.arange(rows), 200)
    pairs = row, np.tile(column, rows), np.tile(value, rows)
    kept_row, kept_column, kept_value = kernel.thin(pairs, np.tile(weight[column], rows))
    assert len(kept_row) <= rows * kernel.MAX_PAIRS_PER_ROW
    mean = np.bincount(kept_column, kept_value, COUNT)[column] / rows
    # Offsets by the golden section are more even than random ones, so the error is smaller.
    tooth = value @ weight[column] / kernel.MAX_PAIRS_PER_ROW / weight[column]
    assert (np.abs(mean - value) <= 5.0 * tooth / np.sqrt(rows)).all()


def dense_scene(interval):
    """Return a model and two sets of one target, far enough apart in time that all rows pair."""
    model = small().model
    rng = np.random.default_rng(4)
    mode = np.arange(COUNT) % 2
    cloud = gaussian_cloud(rng, COUNT, np.zeros(5), [100.0, 7.0, 100.0, 7.0, 1e-2])
    cloud[mode == 0, 4] = 0.0
    earlier = particles(cloud, rng.uniform(0.5, 1.5, COUNT) / COUNT, mode=mode)
    parent = rng.permutation(COUNT)
    moved = np.empty_like(cloud)
    for index, motion in enumerate(model.modes.motions[:2]):
        own = mode[parent] == index
        moved[own] = sample(motion, cloud[parent[own]], interval, rng)
    later = particles(moved, rng.uniform(0.5, 1.5, COUNT) / COUNT, mode=mode[parent])
    return model, earlier, later


@pytest.mark.parametrize("interval", [24.0, 60.0])
def test_a_thinned_dense_kernel_gives_the_same_weights(interval, monkeypatch):
    model, earlier, later = dense_scene(interval)
    # Without births and spawning every later row is explained by survivors alone.
    bare = replace(model, births=(), spawn=replace(model.spawn, rate=0.0))
    few = kernel.build(earlier, later, bare, interval)
    limit = kernel.MAX_PAIRS_PER_ROW
    monkeypatch.setattr(kernel, "MAX_PAIRS_PER_ROW", 1_000_000)
    every = kernel.build(earlier, later, bare, interval)
    assert every.ratio.nnz > 100 * COUNT
    assert np.diff(few.ratio.tocsc().indptr).max() <= limit
    # Both kernels explain each later row exactly once.
    for link in (few, every):
        np.testing.assert_allclose(link.ratio.T @ earlier.weight, 1.0, rtol=1e-9)
    # Moments of the smoothed set, in units of its standard deviation: 128 draws for 600 rows.
    full, drawn = (earlier.weight * (link.ratio @ later.weight) for link in (every, few))
    mean = full @ earlier.state / full.sum()
    std = np.sqrt(full @ (earlier.state - mean) ** 2 / full.sum())
    tracked = std > 0.0
    shift = (drawn @ earlier.state / drawn.sum() - mean)[tracked] / std[tracked]
    assert np.abs(shift).max() < 0.02
    spread = drawn @ (earlier.state - mean) ** 2 / drawn.sum()
    np.testing.assert_allclose(spread[tracked], std[tracked] ** 2, rtol=0.03)
