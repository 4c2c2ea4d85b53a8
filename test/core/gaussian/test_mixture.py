import numpy as np
import pytest

from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.state_space import PLANAR

RNG = np.random.default_rng(0)


def mixture(row_label, modes=2, classes=3):
    count = len(row_label)
    factor = RNG.normal(0.0, 1.0, (count, modes, 5, 5))
    return Mixture(
        np.array(row_label),
        RNG.uniform(0.0, 0.05, (count, modes, classes)),
        RNG.normal(0.0, 100.0, (count, modes, 5)),
        factor @ factor.swapaxes(-1, -2),
        RNG.dirichlet(np.ones(4), (count, classes)),
    )


def test_masses_are_those_of_the_weights():
    found = mixture([7, 7, 9, 12, 12, 12])
    assert found.label.tolist() == [7, 9, 12]
    expected = [found.weight[rows].sum() for rows in ([0, 1], [2], [3, 4, 5])]
    np.testing.assert_allclose(found.existence, expected)
    np.testing.assert_allclose(found.mode_weight.sum(axis=1), found.mass)
    found = mixture([7, 7, 9], classes=2)
    expected = [found.weight[..., 0].sum(), found.weight[..., 1].sum()]
    np.testing.assert_allclose(found.class_mass(np.array([0, 0, 1, 1]), 2), expected)
    some = found.class_mass(np.array([0, 0, 1, 1]), 2, np.array([2]))
    np.testing.assert_allclose(some, found.weight[2].sum(axis=0))


def test_extents_are_the_moments_of_each_target():
    found = mixture([3, 3, 8])
    extents = found.extents(PLANAR)
    for target, rows in enumerate(([0, 1], [2])):
        share = found.mode_weight[rows].ravel() / found.mode_weight[rows].sum()
        states = found.mean[rows].reshape(-1, 5)
        centre = share @ states
        apart = states - centre
        spread = np.tensordot(share, found.covariance[rows].reshape(-1, 5, 5), axes=1)
        spread = spread + (share[:, None] * apart).T @ apart
        variance = np.diag(spread)
        deviations = np.sqrt([variance[[0, 2]].sum(), variance[[1, 3]].sum()])
        expected = [*centre[[0, 2, 1, 3]], *deviations]
        np.testing.assert_allclose(extents.moments[target], expected)
    assert extents.target.tolist() == [0, 0, 1]


def test_joined_and_taken_rows_are_the_same_hypotheses():
    one, other = mixture([1, 2]), mixture([5])
    whole = Mixture.concatenate([one, other, Mixture.empty(2, 3, 4, 5)])
    assert whole.row_label.tolist() == [1, 2, 5]
    np.testing.assert_array_equal(whole.take(np.array([2])).mean, other.mean)


def test_empty_and_read_only_mixtures():
    with pytest.raises(ValueError, match="read-only"):
        mixture([1]).weight[0] = 1.0
    found = Mixture.empty(2, 1, 4, 5)
    assert len(found) == len(found.label) == len(found.existence) == 0
    assert found.class_mass(np.array([0, 0, 0]), 1).tolist() == [0.0]
    assert len(found.extents(PLANAR).label) == 0
