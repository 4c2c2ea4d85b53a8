import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.algebra import blocks

SCALE = np.array([80.0, 9.0, 120.0, 7.0, 0.002])


def covariance(rng, absent=()):
    """Return a random covariance of a planar state, zero on some axes."""
    root = rng.normal(size=(5, 5)) * SCALE[:, None]
    root[list(absent)] = 0.0
    return root @ root.T


@pytest.mark.parametrize("absent", [(), (4,), (1, 3)], ids=["every axis", "no turn", "no speed"])
def test_factors_are_those_of_the_inverse_on_the_axes_with_variance(absent):
    rng = np.random.default_rng(0)
    matrix, factor = covariance(rng, absent), np.empty((5, 5))
    used = np.delete(np.arange(5), absent)
    inverse = np.zeros((5, 5))
    inverse[np.ix_(used, used)] = np.linalg.inv(matrix[np.ix_(used, used)])
    blocks.factorise(matrix, factor)
    one, other = SCALE * rng.normal(size=(2, 5))
    solved = np.array(blocks.solve(factor, one))
    np.testing.assert_allclose(solved, inverse @ one, rtol=1e-8)
    square = blocks.square_distance(factor, one, other, np.empty(5))
    assert square == pytest.approx((one - other) @ inverse @ (one - other), rel=1e-8)
    sign, log_determinant = np.linalg.slogdet(matrix[np.ix_(used, used)])
    assert sign > 0.0
    assert blocks.log_determinant(factor) == pytest.approx(-log_determinant, rel=1e-9)


def test_axis_that_others_determine_is_left_out():
    # x and vx are one: the inverse on the axes that the covariance spans leaves out the second.
    matrix, factor = np.diag(SCALE**2), np.empty((5, 5))
    matrix[0, 1] = matrix[1, 0] = SCALE[0] * SCALE[1]
    blocks.factorise(matrix, factor)
    assert factor[1, 1] == 0.0
    vector = blocks.solve(factor, np.array([1.0, 5.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(vector, [1.0, 0.0, 1.0, 1.0, 1.0] / SCALE**2)


def test_sums_of_mean_and_spread_are_the_moments_of_a_mixture():
    rng = np.random.default_rng(1)
    share, mean = rng.dirichlet(np.ones(3)), SCALE * rng.normal(size=(3, 5))
    spread = np.array([covariance(rng) for _ in range(3)])
    centre, total = np.zeros(5), np.zeros((5, 5))
    for one in range(3):
        blocks.add_mean(share[one], mean[one], centre)
    for one in range(3):
        blocks.add_spread(share[one], mean[one], spread[one], centre, total)
    np.testing.assert_allclose(centre, share @ mean)
    apart = mean - share @ mean
    expected = np.einsum("k,kij->ij", share, spread + apart[:, :, None] * apart[:, None])
    np.testing.assert_allclose(total, expected)
