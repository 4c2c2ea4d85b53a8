"""Hypotheses of lost targets: those of a manoeuvre of constant acceleration."""

from dataclasses import replace

import numpy as np
from lone import MEAN, STD, TWO_MOTIONS, lone, mixture_of

from phd_jdtc_ros.core.attributes.uniqueness import OutOfGate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reacquisition import with_reacquired
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.models.manoeuvre import ACCELERATION, OFFSET, PROBABILITY

SINCE_S = 4.0


def predicted():
    """Return two targets: one of two hypotheses, the second the more probable, and another."""
    model = lone(TWO_MOTIONS).model
    dynamics = Dynamics(model)
    one = mixture_of(dynamics, [(0.2, MEAN, STD)])
    more = mixture_of(dynamics, [(0.5, MEAN + 10.0, STD)])
    other = mixture_of(dynamics, [(0.9, MEAN - 500.0, STD)])
    whole = Mixture.concatenate([one, more, other])
    mixture = replace(whole, row_label=np.array([4, 4, 6]))
    return model, Branched(mixture, np.array([2, 1, 0]))


def lost(target, column, since_s):
    return OutOfGate(np.array(target), np.array(column), np.array(since_s))


def test_reacquired_hypothesis_is_one_of_the_most_probable_one():
    model, before = predicted()
    after = with_reacquired(before, lost([0], [3], [SINCE_S]), model)
    assert after.mixture.row_label.tolist() == [4, 4, 6, 4]
    assert after.parent.tolist() == [2, 1, 0, 1]
    np.testing.assert_array_equal(after.mixture.mean[3], before.mixture.mean[1])
    np.testing.assert_allclose(after.mixture.existence, before.mixture.existence, rtol=1e-12)
    np.testing.assert_allclose(after.mixture.mass[3], PROBABILITY * 0.7, rtol=1e-12)
    after = with_reacquired(before, lost([0, 0], [0, 1], [SINCE_S, SINCE_S]), model)
    assert after.mixture.row_label.tolist() == [4, 4, 6, 4]


def test_stray_is_spread_by_a_constant_acceleration():
    model, before = predicted()
    after = with_reacquired(before, lost([0], [0], [SINCE_S]), model)
    added = after.mixture.covariance[3] - before.mixture.covariance[1]
    lever = np.array([0.5 * SINCE_S**2, SINCE_S])
    expected = ACCELERATION**2 * np.outer(lever, lever)
    expected[0, 0] += OFFSET**2
    for axes in ([0, 1], [2, 3]):
        np.testing.assert_allclose(added[:, axes][:, :, axes], [expected, expected], rtol=1e-9)
    np.testing.assert_array_equal(added[:, :2, 2:4], 0.0)
    # The straight motion has no turn rate, and the other one's is any.
    turn = model.detection_births.turn_rate_std**2
    np.testing.assert_allclose(added[:, 4, 4], [0.0, turn], rtol=1e-9)


def test_stray_that_was_long_unseen_is_no_faster_than_new_targets():
    model, before = predicted()
    after = with_reacquired(before, lost([1], [0], [600.0]), model)
    added = after.mixture.covariance[3] - before.mixture.covariance[2]
    speed = model.detection_births.velocity_std
    np.testing.assert_allclose(added[0, 1, 1], speed**2, rtol=1e-9)
    np.testing.assert_allclose(added[0, 0, 0], (300.0 * speed) ** 2 + OFFSET**2, rtol=1e-9)
