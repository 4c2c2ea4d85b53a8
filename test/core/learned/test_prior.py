"""The mixture prior of log ratios."""

import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.learned.prior import RatioPrior

PRIOR = RatioPrior(0.7, 0.05, 0.8)


@pytest.mark.parametrize("shown", [-1.5, -0.2, 0.0, 0.1, 0.4])
@pytest.mark.parametrize("precision", [1e-3, 4.0, 100.0, 5e3])
def test_posterior_is_that_of_numerical_integration(shown, precision):
    grid = np.linspace(-6.0, 6.0, 400_001)
    prior = PRIOR.right * norm.pdf(grid, scale=PRIOR.scale)
    prior += (1.0 - PRIOR.right) * norm.pdf(grid, scale=PRIOR.wide)
    weight = prior * np.exp(-0.5 * precision * (grid - shown) ** 2)
    mean = np.average(grid, weights=weight)
    variance = np.average((grid - mean) ** 2, weights=weight)
    found = PRIOR.posterior(np.array([shown]), np.array([precision]))
    np.testing.assert_allclose(np.concatenate(found), [mean, variance], rtol=1e-5, atol=1e-8)


def test_without_data_the_prior_stays():
    mean, variance = PRIOR.posterior(np.array([0.3]), np.zeros(1))
    assert mean == 0.0
    assert variance == pytest.approx(0.7 * 0.05**2 + 0.3 * 0.8**2)


def test_certain_data_are_followed_however_far():
    mean, _ = PRIOR.posterior(np.array([-5.0, 5.0]), np.full(2, 1e9))
    np.testing.assert_allclose(mean, [-5.0, 5.0], rtol=1e-6)
