"""The probabilities of the cells of SNR after an update."""

import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.measurement.amplitude import snr_after


@pytest.mark.parametrize("scale", [1.0, 1e-310])
def test_snr_after_a_detection_is_bayes_rule_however_improbable_the_class_is(scale):
    prior, likelihood = np.array([[[0.2, 0.5, 0.3]]]), np.array([[[1.0, 4.0, 2.0]]])
    one, first = np.ones((1, 1, 1)), np.zeros(1, dtype=np.int64)
    cells = np.ones((1, 3)), np.ones((1, 1))
    found = snr_after(prior, one, one, *cells, scale * likelihood, first, first, first)
    expected = prior * likelihood
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-10)
