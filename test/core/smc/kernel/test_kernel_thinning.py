"""Thinning of the backward kernel's rows, and the counted amount of computation and memory."""

import tracemalloc

import numpy as np
import pytest
from scenes import gaussian_cloud, intensity, small

from phd_jdtc_ros.core.pair_search import candidates, grid, sweep
from phd_jdtc_ros.core.pair_search.gating import cell_lists, count_near
from phd_jdtc_ros.core.smc.correction import BERNOULLI, CORRECTORS
from phd_jdtc_ros.core.smc.kernel import (
    backward_kernel,
    kernel_thinning,
    strata,
    transition_density,
)
from phd_jdtc_ros.core.smc.kernel.transition_density import TransitionDensity
from phd_jdtc_ros.core.targets.motion import sample

COUNT = 600
SPACING = 2500.0


def pairs_of(counts, seed=0):
    """Return rows with the given numbers of pairs, of unequal kernel and weight."""
    rng = np.random.default_rng(seed)
    row = np.repeat(np.flatnonzero(counts), np.array(counts)[np.flatnonzero(counts)])
    column = np.concatenate([rng.permutation(COUNT)[:count] for count in counts])
    weight = rng.uniform(0.5, 1.5, COUNT) / COUNT
    return row, column, rng.exponential(1.0, len(row)), weight


def test_thin_leaves_short_rows_alone():
    row, column, value, weight = pairs_of([kernel_thinning.MAX_PAIRS_PER_ROW, 0, 3])
    kept = kernel_thinning.thin(row, column, value, weight[column])
    for found, given in zip(kept, (row, column, value), strict=True):
        np.testing.assert_array_equal(found, given)


def test_thin_keeps_the_sum_of_every_row_in_few_pairs():
    row, column, value, weight = pairs_of([500, 4, 0, 90])
    kept_row, kept_column, kept_value = kernel_thinning.thin(row, column, value, weight[column])
    before = np.bincount(row, value * weight[column])
    np.testing.assert_allclose(
        np.bincount(kept_row, kept_value * weight[kept_column]), before, rtol=1e-12
    )
    assert np.bincount(kept_row).max() <= kernel_thinning.MAX_PAIRS_PER_ROW
    few, kept_few = row == 1, kept_row == 1
    np.testing.assert_array_equal(kept_value[kept_few], value[few])


def test_thin_does_not_depend_on_the_order_of_pairs():
    row, column, value, weight = pairs_of([300])
    mixed = np.random.default_rng(1).permutation(len(row))
    first = kernel_thinning.thin(row, column, value, weight[column])
    second = kernel_thinning.thin(row, column[mixed], value[mixed], weight[column[mixed]])
    for found in (first, second):
        order = np.argsort(found[1])
        np.testing.assert_array_equal(found[1][order], np.sort(first[1]))
        np.testing.assert_allclose(found[2][order], first[2][np.argsort(first[1])], rtol=1e-12)


def test_thin_is_fair_over_many_rows():
    # All rows have the same pairs; only the offset of the comb differs from row to row.
    rows = 2000
    _, column, value, weight = pairs_of([200])
    row = np.repeat(np.arange(rows), 200)
    kept_row, kept_column, kept_value = kernel_thinning.thin(
        row, np.tile(column, rows), np.tile(value, rows), np.tile(weight[column], rows)
    )
    assert len(kept_row) <= rows * kernel_thinning.MAX_PAIRS_PER_ROW
    mean = np.bincount(kept_column, kept_value, COUNT)[column] / rows
    # Offsets by the golden section are more even than random ones, so the error is smaller.
    tooth = value @ weight[column] / kernel_thinning.MAX_PAIRS_PER_ROW / weight[column]
    assert (np.abs(mean - value) <= 5.0 * tooth / np.sqrt(rows)).all()


@pytest.mark.parametrize("size", [1, 7, 100, 10_000])
def test_complete_rows_does_not_split_a_row(size):
    row, column, value, _ = pairs_of([5, 0, 200, 1, 128])
    chunks = [
        (row[k : k + size], column[k : k + size], value[k : k + size])
        for k in range(0, len(row), size)
    ]
    found = list(kernel_thinning.complete_rows(chunks))
    for index, given in enumerate((row, column, value)):
        np.testing.assert_array_equal(np.concatenate([part[index] for part in found]), given)
    rows = [index for part in found for index in np.unique(part[0])]
    assert rows == sorted(set(rows))


def dense_scene(interval):
    """Return a model and two sets of one target, far enough apart in time that all rows pair."""
    model = small().model
    rng = np.random.default_rng(4)
    mode = np.arange(COUNT) % 2
    cloud = gaussian_cloud(rng, COUNT, np.zeros(5), [100.0, 7.0, 100.0, 7.0, 1e-2])
    cloud[mode == 0, 4] = 0.0
    earlier = intensity(cloud, rng.uniform(0.5, 1.5, COUNT) / COUNT, mode=mode)
    parent = rng.permutation(COUNT)
    moved = np.empty_like(cloud)
    for index, motion in enumerate(model.modes.motions[:2]):
        own = mode[parent] == index
        moved[own] = sample(motion, cloud[parent[own]], interval, rng)
    later = intensity(moved, rng.uniform(0.5, 1.5, COUNT) / COUNT, mode=mode[parent])
    return model, earlier, later


@pytest.mark.parametrize("interval", [24.0, 60.0])
def test_a_thinned_dense_kernel_gives_the_same_weights(interval, monkeypatch):
    model, earlier, later = dense_scene(interval)
    few = backward_kernel.build(earlier, later, model, BERNOULLI, interval)
    limit = kernel_thinning.MAX_PAIRS_PER_ROW
    monkeypatch.setattr(kernel_thinning, "MAX_PAIRS_PER_ROW", 1_000_000)
    monkeypatch.setattr(strata, "DENSE", 1_000_000)
    every = backward_kernel.build(earlier, later, model, BERNOULLI, interval)
    assert every.ratio.nnz > 100 * COUNT
    assert np.diff(few.ratio.indptr).max() <= limit
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


def groups_of(interval, origins, rows=COUNT):
    """Return the groups that rows of some origins are searched in, later and earlier ones."""
    model, earlier, later = dense_scene(interval)
    modes, motions = model.modes, dict.fromkeys(model.modes.motions)
    successor = {motion: motion.mean(earlier.state, interval) for motion in motions}
    noise = {motion: motion.noise_covariance(interval) for motion in motions}
    kernel = TransitionDensity.of_noise(
        *(noise, modes, modes.transition(interval), successor),
        *(earlier.mode, np.ones(len(earlier))),
    )
    group = np.arange(rows) % origins
    return strata.split_into_strata(
        kernel, earlier, later, (group, group), backward_kernel.KERNEL_GATE_SIGMA
    )


def test_dense_group_is_divided_evenly():
    for side in groups_of(60.0, origins=1):
        size = np.bincount(side)
        assert 2 <= len(size) <= COUNT // strata.LEFT
        assert size.max() - size.min() <= 1


@pytest.mark.parametrize(("interval", "origins"), [(1.0, 1), (60.0, 4)], ids=["sparse", "small"])
def test_group_of_few_pairs_is_left_whole(interval, origins):
    later, earlier = groups_of(interval, origins)
    assert later.max() == earlier.max() == origins - 1


def tracked(targets, per_target, corrector="poisson", spacing=SPACING):
    """Return the arguments of a build: two stored sets of well-tracked targets, 6 s apart.

    With the PHD filter's corrector spawned targets are in mu, and no row_label keeps rows apart.
    """
    model = small().model
    rng = np.random.default_rng(targets)
    mode = np.repeat(np.arange(targets) % 4, per_target)
    # The targets are in a square, so that a search over one coordinate would find rows of other
    # targets.
    side = int(np.ceil(np.sqrt(targets)))
    place = np.repeat(np.arange(targets), per_target)
    centre = np.zeros((len(place), 5))
    centre[:, 0], centre[:, 2] = spacing * (place // side), spacing * (place % side)
    centre[:, 1] = 40.0
    state = gaussian_cloud(rng, len(place), centre, [100.0, 7.0, 100.0, 7.0, 1e-2])
    state[mode % 2 == 0, 4] = 0.0
    weight = np.full(len(place), 1.0 / per_target)
    earlier = intensity(state, weight, mode=mode, row_label=place)
    moved = np.empty_like(state)
    for index, motion in enumerate(model.modes.motions):
        moved[mode == index] = sample(motion, state[mode == index], 6.0, rng)
    later = intensity(moved, weight, mode=mode, row_label=place)
    return earlier, later, model, CORRECTORS[corrector], 6.0


def candidates_of_a_build(monkeypatch, *scene):
    """Return candidates tested per later row by every search, and the kernel's pairs."""
    case = tracked(*scene)
    tested = []

    def counted(search):
        def count(*arguments):
            found = search(*arguments)
            tested.append(found.count.sum())
            return found

        return count

    with monkeypatch.context() as patch:
        patch.setattr(transition_density, "candidates", counted(sweep.candidates))
        patch.setattr(transition_density, "grid_candidates", counted(grid.grid_candidates))
        link = backward_kernel.build(*case)
    rows = len(case[1])
    return np.array(tested) / rows, link.ratio.nnz / rows


def test_build_tests_as_many_candidates_a_row_whatever_the_number_of_targets(monkeypatch):
    few, _ = candidates_of_a_build(monkeypatch, 64, 150)
    many, _ = candidates_of_a_build(monkeypatch, 256, 150)
    survival, spawn = many / few
    assert survival <= 1.05
    # The axes that serve best change on the way; other targets in one strip would double it.
    assert spawn <= 1.5


def test_build_tests_few_candidates_for_a_pair(monkeypatch):
    (survival, spawn), pairs = candidates_of_a_build(monkeypatch, 8, 300)
    assert pairs > 3.0
    assert survival <= 4.0 * pairs
    assert spawn <= 30.0 * pairs


def test_build_within_origins_tests_no_strangers(monkeypatch):
    # All targets in one place: without origins every row would be paired with those of all targets.
    (one,), pairs = candidates_of_a_build(monkeypatch, 4, 150, "bernoulli", 0.0)
    (many,), _ = candidates_of_a_build(monkeypatch, 64, 150, "bernoulli", 0.0)
    assert one <= 4.0 * pairs
    assert many <= 1.1 * one


def peak_bytes(call):
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("corrector", ["poisson", "bernoulli"])
@pytest.mark.parametrize("targets", [8, 32])
def test_build_peak_memory_is_some_columns_a_row(targets, corrector):
    case = tracked(targets, 150, corrector)
    peak = peak_bytes(lambda: backward_kernel.build(*case))
    # A dense kernel has 8 bytes for every pair of rows: 10 and 38 kB per row here.
    # Chunks of candidates are a constant part.
    assert peak <= 1100 * len(case[1]) + 80 * candidates.CHUNK_PAIRS


@pytest.mark.parametrize("reports", [10, 300])
def test_gating_lists_little_more_than_it_keeps(reports):
    # Against both gates, 3.6 km of 15 km and 12 of 360 degrees, at every particle.
    rng = np.random.default_rng(0)
    area = np.array([15e3, 2.0 * np.pi])
    measured = rng.uniform(0.0, 1.0, (reports, 2)) * area - [0.0, np.pi]
    particles = rng.uniform(0.0, 1.0, (20_000, 2)) * area - [0.0, np.pi]
    lists = cell_lists(measured, 1800.0, np.radians(6.0))
    compared = np.diff(lists.start)[lists.cells.of(particles)]
    assert count_near(measured, 1800.0, np.radians(6.0), particles) == compared.sum()
    kept = reports * (3600.0 / area[0]) * (np.radians(12.0) / area[1])
    assert compared.mean() <= 2.0 * kept


def test_gating_lists_stay_small_for_gates_of_nothing():
    lists = cell_lists(np.array([[15e3, 0.1], [1.0, 3.0]]), 1e-3, 1e-9)
    assert len(lists.start) < 20_000
    assert len(lists.detection) <= 8
