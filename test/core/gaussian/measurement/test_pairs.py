"""The pairs of hypotheses and detections that are likely enough for a joint update."""

import numpy as np
import pytest
from lone import MEAN, STD, lone, mixture_of

from phd_jdtc_ros.core.arrays import contiguous
from phd_jdtc_ros.core.association.marginals import LEAST_CLUTTER
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import pairs
from phd_jdtc_ros.core.gaussian.mixture import Mixture


@pytest.mark.parametrize(
    ("existence", "missed", "odds", "kept"),
    [
        # A target has one of two detections, or the other.
        (0.9, 0.1, [1.0, 2.5], [1]),
        (0.9, 0.1, [1.0, 2.0], [0, 1]),
        # It may be missed instead, or may not exist.
        (0.5, 0.4, [0.45, 0.2], []),
        (0.5, 0.1, [0.45, 0.2], [0]),
    ],
)
def test_likely_pairs_are_of_a_share_of_all_that_may_be(existence, missed, odds, kept, monkeypatch):
    monkeypatch.setattr(pairs, "LEAST_SHARE", 0.3)
    mixture = mixture_of(Dynamics(lone({}).model), [(existence, MEAN, STD)])
    row, column, none = np.zeros(2, dtype=int), np.arange(2), np.zeros(2)
    log_likelihood = np.log(np.array(odds) / existence)[:, None]
    likelihoods = pairs.PairLikelihoods(row, column, log_likelihood, none, none, none[None])
    detection_probability = np.full((1, 1, 1), 1.0 - missed / existence)
    found, amplitude = pairs.select_likely(
        mixture, detection_probability, likelihoods, np.ones((2, 1, 1))
    )
    np.testing.assert_array_equal(amplitude, np.ones((len(kept), 1)))
    np.testing.assert_array_equal(found, kept)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_likely_pairs_may_be_more_than_the_least_share_of_their_target(seed, count, monkeypatch):
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(pairs, "LEAST_SHARE", 0.3)
    config = lone({})
    single = mixture_of(Dynamics(config.model), [(1.0, MEAN, STD)])
    row_label, rows = np.array([3, 3, 5, 9]), np.arange(4)
    mixture = Mixture(
        row_label,
        rng.uniform(0.1, 0.45, 4)[:, None, None],
        single.mean[0 * rows],
        single.covariance[0 * rows],
        single.snr[0 * rows],
    )
    row, column = contiguous(*np.nonzero(rng.random((4, count)) < 0.9))
    weight = rng.exponential(1.0, len(row)) * 10.0 ** rng.uniform(-3, 0.5, len(row))
    detection_probability = 1.0 - rng.uniform(0.1, 0.9, (4, 1, 1))
    missed = mixture.weight * (1.0 - detection_probability)
    total = np.array([0.3, 1e-12, 2.0])[:count]
    log_likelihood = np.log(weight / mixture.mass[row])
    likelihoods = pairs.PairLikelihoods(
        *(row, column, log_likelihood[:, None], np.zeros(count), np.zeros(len(row))),
        np.log(total)[None],
    )
    found, _ = pairs.select_likely(
        mixture, detection_probability, likelihoods, np.ones((count, 1, 1))
    )

    scale = np.log(total)
    np.maximum.at(scale, column, log_likelihood)
    weight, total = weight * np.exp(-scale)[column], total * np.exp(-scale)
    odds = weight / np.maximum(total, LEAST_CLUTTER)[column]
    expected = []
    for pair in range(len(row)):
        own = row_label[row] == row_label[row[pair]]
        alone = 1.0 - mixture.weight[row_label == row_label[row[pair]]].sum()
        alone += missed[row_label == row_label[row[pair]]].sum()
        for z in range(count):
            here = column == z
            alone += odds[own & here].sum() / (1.0 + odds[~own & here].sum())
        if odds[pair] > 0.3 * max(alone, 1.0):
            expected.append(pair)
    np.testing.assert_array_equal(found, expected)
