import numpy as np

from phd_jdtc_ros.core.gaussian.algebra import moments


def of_parts(share, mean, covariance):
    """Return the mean and covariance of one mixture, part by part."""
    centre = sum(w * m for w, m in zip(share, mean, strict=True))
    second = sum(w * (c + np.outer(m, m)) for w, m, c in zip(share, mean, covariance, strict=True))
    return centre, second - np.outer(centre, centre)


def test_merge_moments_keeps_the_moments_of_mixtures_in_any_order():
    rng = np.random.default_rng(1)
    mixture = np.array([2, 0, 2, 3, 0, 2])
    share = np.empty(6)
    for one in (0, 2, 3):
        share[mixture == one] = rng.dirichlet(np.ones((mixture == one).sum()))
    mean, root = rng.normal(0.0, 10.0, (6, 5)), rng.normal(0.0, 1.0, (6, 5, 5))
    covariance = root @ root.swapaxes(-1, -2)
    centre, spread = moments.merge_moments(4, share, mean, covariance, mixture)
    for one in (0, 2, 3):
        own = mixture == one
        expected = of_parts(share[own], mean[own], covariance[own])
        np.testing.assert_allclose(centre[one], expected[0], rtol=1e-10)
        np.testing.assert_allclose(spread[one], expected[1], rtol=1e-8, atol=1e-9)
    assert not centre[1].any()
    assert not spread[1].any()
