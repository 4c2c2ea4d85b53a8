import numpy as np
import pytest
from matchings import enumerated

from phd_jdtc_ros.core import backend
from phd_jdtc_ros.core.association.exact_marginals import Batch, ExactMarginals


def batch_of(tables):
    """Return the batch of dense odds, (T, M) each, with T in descending order."""
    parts = [(*np.nonzero(odds), c) for c, odds in enumerate(tables)]
    row = np.concatenate([row for row, _, _ in parts])
    column = np.concatenate([column for _, column, _ in parts])
    cluster = np.concatenate([np.full(len(row), c) for row, _, c in parts])
    odds = np.concatenate([odds[np.nonzero(odds)] for odds in tables])
    order = np.lexsort((row, column))
    rows = np.array([len(odds) for odds in tables])
    return Batch(row[order], column[order], cluster[order], odds[order], rows, tables[0].shape[1])


def random_tables(rng, rows, size):
    tables = [rng.exponential(2.0, (t, size)) for t in rows]
    return [odds * (rng.random(odds.shape) < 0.8) for odds in tables]


@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_exact_marginals_are_the_sums_over_all_matchings(size):
    tables = random_tables(np.random.default_rng(size), [5, 4, 4, 2, 1], size)
    batch = batch_of(tables)
    found = ExactMarginals(batch)
    dense = [np.zeros_like(odds) for odds in tables]
    for t, z, c, probability in zip(*batch[:3], found.edges(), strict=True):
        dense[c][t, z] = probability
    expected = [enumerated(odds, np.ones(size)) for odds in tables]
    for own, (edge, _) in zip(dense, expected, strict=True):
        np.testing.assert_allclose(own, edge, rtol=1e-12)
    none = np.concatenate([none for _, none in expected])
    np.testing.assert_allclose(found.unassociated_rows(), none, rtol=1e-12)
    free = [enumerated(odds.T, np.ones(len(odds)))[1] for odds in tables]
    np.testing.assert_allclose(found.unassociated_columns(), free, rtol=1e-12)


def test_exact_marginals_of_a_cluster_have_the_same_bits_in_any_batch():
    tables = random_tables(np.random.default_rng(1), [7, 6, 6, 4, 3, 3, 2], 5)
    batch = batch_of(tables)
    together = ExactMarginals(batch)
    alone = [ExactMarginals(batch_of([odds])) for odds in tables]
    edges = together.edges()
    for c, own in enumerate(alone):
        np.testing.assert_array_equal(edges[batch.cluster == c], own.edges())
    rows = [own.unassociated_rows() for own in alone]
    np.testing.assert_array_equal(together.unassociated_rows(), np.concatenate(rows))


@pytest.mark.parametrize("odds", [1e12, 1e21, 1e300, np.inf])
@pytest.mark.parametrize("size", [2, 7, 12])
def test_exact_marginals_of_extreme_odds_are_finite(size, odds):
    table = np.full((size + 3, size), odds)
    table[0, 0], table[1, 1] = 1e-300, 1.0
    found = ExactMarginals(batch_of([table]))
    edge, none = found.edges(), found.unassociated_rows()
    assert np.isfinite(edge).all()
    assert (found.unassociated_columns() < 1e-6).all()
    # Every detection has a source, and three targets have none.
    assert edge.sum() == pytest.approx(size)
    assert none.sum() == pytest.approx(3.0)


@pytest.mark.parametrize("size", [1, 2, 5, 9])
def test_exact_marginals_of_all_backends_have_the_same_bits(size):
    pytest.importorskip("numba", reason="numba is optional: pip install '.[fast]'")
    rng = np.random.default_rng(size)
    batch = batch_of(random_tables(rng, -np.sort(-rng.integers(1, 9, 12)), size))
    results = []
    for name in (backend.NUMPY, backend.NUMBA):
        with backend.using(name):
            found = ExactMarginals(batch)
            results.append((found.edges(), found.unassociated_rows(), found.unassociated_columns()))
    for plain, compiled in zip(*results, strict=True):
        np.testing.assert_array_equal(plain, compiled)
