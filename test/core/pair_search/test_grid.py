import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from phd_jdtc_ros.core.pair_search import candidates, grid


def check(query, query_group, point, point_group, radius):
    tested = grid.grid_candidates(query, query_group, point, point_group, radius)
    found = list(candidates.near_chunks(tested))
    empty = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
    row, column, square = (np.concatenate(part) for part in zip(empty, *found, strict=True))
    limit = (cdist(query, point) <= radius) & (query_group[:, None] == point_group)
    assert sorted(zip(row.tolist(), column.tolist(), strict=True)) == list(
        map(tuple, np.argwhere(limit).tolist())
    )
    assert (np.diff(row) >= 0).all()
    exact = ((query[row] - point[column]) ** 2).sum(axis=1)
    np.testing.assert_allclose(square, exact, rtol=1e-12, atol=1e-12)
    return len(row)


def clouds(rng, groups, count, dimension, spread):
    """Return clouds that lie apart and in one another, each wide along axes of its own."""
    group = rng.integers(0, groups, count)
    centre = rng.normal(0.0, 50.0, (groups, dimension))
    width = spread ** rng.uniform(-1.0, 1.0, (groups, dimension))
    return centre[group] + width[group] * rng.normal(0.0, 1.0, (count, dimension)), group


@given(
    seed=st.integers(0, 10**6),
    groups=st.integers(1, 5),
    sizes=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    dimension=st.integers(2, 5),
    spread=st.sampled_from([1.0, 20.0, 1e4]),
    radius=st.sampled_from([0.5, 7.5, 100.0]),
)
def test_within_groups_equal_brute_force(seed, groups, sizes, dimension, spread, radius):
    rng = np.random.default_rng(seed)
    both, group = clouds(rng, groups, sum(sizes), dimension, spread)
    parts = np.split(both, sizes[:1]), np.split(group, sizes[:1])
    check(parts[0][0], parts[1][0], parts[0][1], parts[1][1], radius)


def test_within_groups_find_all_pairs_up_to_the_radius():
    point, group = np.zeros((300, 4)), np.repeat([0, 1, 2], 100)
    assert check(point, group, point, group, 1.0) == 3 * 100**2
    axis = np.arange(-30.0, 31.0)
    point = np.stack([axis, np.zeros(61), np.zeros(61)], axis=1)
    group = np.zeros(61, dtype=np.int64)
    assert check(point, group, point, group, 7.0) == 61 * 15 - 2 * 28


@pytest.mark.parametrize("far", [1e5, 1e12, -1e12])
def test_within_groups_of_far_queries_are_none(far):
    rng = np.random.default_rng(0)
    point = rng.normal(0.0, 5.0, (50, 3))
    group = np.zeros(50, dtype=np.int64)
    assert check(point + far, group, point, group, 7.0) == 0


@pytest.mark.parametrize("axis", [0, 2])
def test_a_cloud_like_a_line_needs_no_more_cells_than_its_points_can_fill(axis, monkeypatch):
    point = np.zeros((2, 3))
    point[1, axis] = 1e9
    group = np.zeros(2, dtype=np.int64)
    cells = []
    sort_by_cell = grid._sort_by_cell
    monkeypatch.setattr(
        grid,
        "_sort_by_cell",
        lambda cell, number: cells.append(number) or sort_by_cell(cell, number),
    )
    assert check(point, group, point, group, 7.5) == 2
    assert cells[0] <= 4 * grid.MAX_CELLS_PER_POINT


def test_within_groups_of_far_spread_clouds_need_few_cells():
    rng = np.random.default_rng(0)
    point, group = clouds(rng, 20, 2000, 4, 1e6)
    found = grid.grid_candidates(point, group, point, group, 7.5)
    near = sum(len(part.query) for part in candidates.near_chunks(found))
    assert len(found.rank) == 2000
    assert found.count.sum() <= 12 * near
