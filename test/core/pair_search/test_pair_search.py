"""The search of near pairs within groups, by a sweep, against brute force."""

from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from phd_jdtc_ros.core.pair_search import candidates, sweep

KINDS = ("wide", "clustered", "flat", "duplicate", "own axes")


def check(query, query_group, point, point_group, radius):
    """Compare all near pairs with those of brute force, and return their number."""
    tested = sweep.candidates(query, query_group, point, point_group, radius)
    empty = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
    found = list(candidates.near_chunks(tested))
    row, column, square = (np.concatenate(part) for part in zip(empty, *found, strict=True))
    limit = np.full(len(query), radius)[:, None]
    near = (cdist(query, point) <= limit) & (query_group[:, None] == point_group)
    pairs = sorted(zip(row.tolist(), column.tolist(), strict=True))
    assert pairs == list(map(tuple, np.argwhere(near).tolist()))
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


def draw_points(rng, kind, count, dimension):
    if kind == "wide":
        return rng.uniform(-1e3, 1e3, (count, dimension))
    if kind == "clustered":
        centre = rng.uniform(-1e4, 1e4, (3, dimension))
        return centre[rng.integers(0, 3, count)] + rng.normal(0.0, 2.0, (count, dimension))
    if kind == "flat":
        # Two wide axes that are not the first two, as whitening makes them.
        scale = np.ones(dimension)
        scale[[0, -1]] = 200.0
        return rng.normal(0.0, 1.0, (count, dimension)) * scale
    return np.repeat(rng.normal(0.0, 3.0, (1, dimension)), count, axis=0)  # duplicates


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(KINDS),
    sizes=st.tuples(st.integers(0, 60), st.integers(0, 60)),
    dimension=st.integers(2, 5),
    groups=st.integers(1, 5),
    spread=st.sampled_from([1.0, 20.0, 1e4]),
    radius=st.sampled_from([0.3, 2.0, 7.5, 100.0, 300.0]),
    chunk=st.sampled_from([1, 7, 1 << 18]),
)
def test_near_pairs_equal_brute_force(seed, kind, sizes, dimension, groups, spread, radius, chunk):
    rng = np.random.default_rng(seed)
    if kind == "own axes":
        both, group = clouds(rng, groups, sum(sizes), dimension, spread)
    else:
        both = draw_points(rng, kind, sum(sizes), dimension)
        group = rng.integers(0, groups, sum(sizes))
    (query, point), (own, other) = np.split(both, sizes[:1]), np.split(group, sizes[:1])
    with mock.patch.object(candidates, "CHUNK_PAIRS", chunk):
        check(query, own, point, other, radius)


@settings(deadline=None, max_examples=100)
@given(
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(KINDS[:4]),
    sizes=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    spread=st.sampled_from([1.0, 3.0, 100.0]),
)
def test_sweep_takes_a_radius_for_each_query(seed, kind, sizes, spread):
    rng = np.random.default_rng(seed)
    query, point = np.split(draw_points(rng, kind, sum(sizes), 4), sizes[:1])
    own, other = np.split(rng.integers(0, 2, sum(sizes)), sizes[:1])
    radius = 2.0 * spread ** rng.uniform(-1.0, 1.0, sizes[0])
    check(query, own, point, other, radius)


@pytest.mark.parametrize("radius", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("origin", [0.0, -7.0, 1e7])
def test_sweep_includes_pairs_exactly_as_far_as_the_radius(radius, origin):
    side = np.arange(9.0)
    lattice = np.stack(np.meshgrid(side, side, [0.0, 3.0]), axis=-1).reshape(-1, 3) + origin
    none = np.zeros(len(lattice), int)
    check(lattice[::-1], none, lattice, none, radius)


def test_all_pairs_up_to_the_radius_are_found_and_none_of_far_queries():
    point, group = np.zeros((300, 4)), np.repeat([0, 1, 2], 100)
    assert check(point, group, point, group, 1.0) == 3 * 100**2
    axis = np.arange(-30.0, 31.0)
    point = np.stack([axis, np.zeros(61), np.zeros(61)], axis=1)
    group = np.zeros(61, dtype=np.int64)
    assert check(point, group, point, group, 7.0) == 61 * 15 - 2 * 28
    point = np.random.default_rng(0).normal(0.0, 5.0, (50, 3))
    for far in (1e5, 1e12, -1e12):
        assert check(point + far, group[:50], point, group[:50], 7.0) == 0
