import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.algebra import moments

pytestmark = pytest.mark.usefixtures("backend")


def random_mixtures(rng, count, parts):
    share = rng.dirichlet(np.ones(parts), count)
    mean = rng.normal(0.0, 10.0, (count, parts, 5))
    factor = rng.normal(0.0, 1.0, (count, parts, 5, 5))
    return share, mean, factor @ factor.swapaxes(-1, -2)


def of_samples(share, mean, covariance):
    """Return the mean and covariance of one mixture, part by part."""
    centre = sum(w * m for w, m in zip(share, mean, strict=True))
    second = sum(w * (c + np.outer(m, m)) for w, m, c in zip(share, mean, covariance, strict=True))
    return centre, second - np.outer(centre, centre)


def test_matched_keeps_the_mean_and_covariance_of_each_mixture():
    rng = np.random.default_rng(0)
    share, mean, covariance = random_mixtures(rng, 6, 3)
    other = rng.dirichlet(np.ones(3), 6)
    found_mean, found = moments.match_moments(np.stack([share, other], axis=1), mean, covariance)
    for row in range(6):
        for column, weights in enumerate((share, other)):
            centre, spread = of_samples(weights[row], mean[row], covariance[row])
            np.testing.assert_allclose(found_mean[row, column], centre, rtol=1e-10)
            np.testing.assert_allclose(found[row, column], spread, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("first", [[0], [0, 1, 2, 3], [0, 3], [0, 1, 3]])
def test_merged_keeps_the_moments_of_runs_of_rows(first):
    rng = np.random.default_rng(1)
    _, mean, covariance = random_mixtures(rng, 4, 2)
    ends = [*first[1:], 4]
    share = np.concatenate(
        [rng.dirichlet(np.ones(b - a), 2).T for a, b in zip(first, ends, strict=True)]
    )
    found_mean, found = moments.merge_moments(share, mean, covariance, np.array(first))
    for run, (a, b) in enumerate(zip(first, ends, strict=True)):
        for column in range(2):
            centre, spread = of_samples(
                share[a:b, column], mean[a:b, column], covariance[a:b, column]
            )
            np.testing.assert_allclose(found_mean[run, column], centre, rtol=1e-10)
            np.testing.assert_allclose(found[run, column], spread, rtol=1e-8, atol=1e-9)
