"""The share of outliers, learned from the probabilities that detections are some."""

import numpy as np
import pytest

from phd_jdtc_ros.core.association.evidence import OutlierEvidence
from phd_jdtc_ros.core.factors.outliers import Outliers


def learned(rng, share, count, ratio=3.0):
    """Return the outliers after reports of ten innovations of variance 1, known exactly."""
    outliers = Outliers()
    for _ in range(count // 10):
        innovation = rng.standard_normal(10) * np.where(rng.random(10) < share, ratio, 1.0)
        usual = (1.0 - outliers.share) * np.exp(-0.5 * innovation**2)
        large = outliers.share * np.exp(-0.5 * (innovation / ratio) ** 2) / ratio
        evidence = OutlierEvidence(10.0, float((large / (usual + large)).sum()))
        outliers = outliers.after(evidence)
    return outliers


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_share_is_found(share):
    shares = [learned(np.random.default_rng(seed), share, 2000).share for seed in range(30)]
    # The share that learning starts from has a weight of some twenty of these innovations.
    assert np.mean(shares) == pytest.approx(share + 0.07 * (Outliers.start - share), abs=0.01)
    assert np.std(shares) < 0.02


def test_share_begins_at_the_start_and_follows_a_change():
    assert Outliers().share == Outliers.start
    before = Outliers().after(OutlierEvidence(1000.0, 300.0))
    assert before.share == pytest.approx(0.3, abs=0.005)
    after = before
    for _ in range(100):
        after = after.after(OutlierEvidence(20.0, 1.0))
    assert after.share == pytest.approx(0.05, abs=0.01)
    assert after.std < Outliers().std


def test_share_never_becomes_zero():
    assert Outliers().after(OutlierEvidence(1e6, 0.0)).share == Outliers.LEAST
