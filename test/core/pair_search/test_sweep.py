from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from phd_jdtc_ros.core.pair_search import candidates, sweep


def pairs_within(query, query_block, point, point_block, radius):
    """Return the query, the point and the square distance of all near pairs."""
    search = sweep.candidates(query, query_block, point, point_block, radius)
    found = list(candidates.near_chunks(search))
    none = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
    return [np.concatenate(part) for part in zip(none, *found, strict=True)]


def brute_force(query, query_block, point, point_block, radius):
    limit = np.full(len(query), radius)[:, None]
    near = (cdist(query, point) <= limit) & (query_block[:, None] == point_block)
    return set(map(tuple, np.argwhere(near)))


def check(query, query_block, point, point_block, radius):
    row, column, square = pairs_within(query, query_block, point, point_block, radius)
    found = list(zip(row.tolist(), column.tolist(), strict=True))
    expected = brute_force(query, query_block, point, point_block, radius)
    assert len(found) == len(expected)
    assert set(found) == expected
    assert (np.diff(row) >= 0).all()
    exact = ((query[row] - point[column]) ** 2).sum(axis=1)
    np.testing.assert_allclose(square, exact, rtol=1e-12, atol=1e-12)
    return found


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
    kind=st.sampled_from(["wide", "clustered", "flat", "duplicate"]),
    sizes=st.tuples(st.integers(0, 40), st.integers(0, 40)),
    dimension=st.integers(2, 5),
    blocks=st.integers(1, 4),
    radius=st.sampled_from([0.3, 2.0, 7.0, 300.0]),
    chunk=st.sampled_from([1, 7, 1 << 18]),
)
def test_pairs_within_equal_brute_force(seed, kind, sizes, dimension, blocks, radius, chunk):
    rng = np.random.default_rng(seed)
    both = draw_points(rng, kind, sum(sizes), dimension)
    query, point = both[: sizes[0]], both[sizes[0] :]
    query_block, point_block = (rng.integers(0, blocks, size) for size in sizes)
    with mock.patch.object(candidates, "CHUNK_PAIRS", chunk):
        check(query, query_block, point, point_block, radius)


@settings(deadline=None, max_examples=100)
@given(
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(["wide", "clustered", "flat", "duplicate"]),
    sizes=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    spread=st.sampled_from([1.0, 3.0, 100.0]),
)
def test_pairs_within_take_a_radius_for_each_query(seed, kind, sizes, spread):
    rng = np.random.default_rng(seed)
    both = draw_points(rng, kind, sum(sizes), 4)
    blocks = rng.integers(0, 2, sum(sizes))
    radius = 2.0 * spread ** rng.uniform(-1.0, 1.0, sizes[0])
    check(both[: sizes[0]], blocks[: sizes[0]], both[sizes[0] :], blocks[sizes[0] :], radius)


@pytest.mark.parametrize("radius", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("origin", [0.0, -7.0, 1e7])
def test_pairs_within_include_those_exactly_as_far_as_the_radius(radius, origin):
    side = np.arange(9.0)
    lattice = np.stack(np.meshgrid(side, side, [0.0, 3.0]), axis=-1).reshape(-1, 3) + origin
    none = np.zeros(len(lattice), int)
    check(lattice[::-1], none, lattice, none, radius)
