"""The update of several targets: all association events, composed of updates of one alone."""

from functools import partial

import numpy as np
import pytest
from lone import BANDS, MEAN, STD, TWO_MOTIONS, UNREDUCED, lone, mixture_of
from matchings import posterior

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import likely_pairs
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.core.window.update import Updated, update

# The amplitude tells classes, and cells of their bands, which have detection probabilities of their
# own; and the radar's range ends among the hypotheses.
GIVEN = {
    **TWO_MOTIONS,
    **UNREDUCED,
    **BANDS,
    "amplitude": "memory",
    "radar.detection_probability": 0.0,
    "radar.clutter_rate": 40.0,
    "radar.clutter_max_range": 1e4,
    "radar.max_range": 1.005e4,
}
SIZES = (1, 2, 3)


@pytest.fixture(autouse=True)
def _nothing_left_out(monkeypatch):
    """Let every update take all its iterations, and look at all pairs within the gates."""
    monkeypatch.setattr(likely_pairs, "LEAST_SHARE", 0.0)
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def hypotheses(dynamics, targets, rng):
    """Return targets next to each other, with one, two and three hypotheses of random weights."""
    single = mixture_of(dynamics, [(1.0, MEAN, STD)])
    row_label = np.repeat([5, 7, 9][:targets], SIZES[:targets])
    weight = rng.uniform(0.1, 1.0, (len(row_label), *single.weight.shape[1:])) * (
        single.weight > 0.0
    )
    existence = rng.uniform(0.2, 0.99, targets)
    target = np.unique(row_label, return_inverse=True)[1]
    mass = np.bincount(target, weight.sum(axis=(1, 2)))
    apart = rng.normal(0.0, [200.0, 10.0, 200.0, 10.0, 0.0], (len(row_label), 1, 5))
    mean = single.mean + apart
    size = rng.uniform(0.3, 1.0, len(row_label))
    return Mixture(
        row_label,
        weight * (existence / mass)[target][:, None, None],
        mean,
        size[:, None, None, None] * single.covariance,
        dynamics.unknown_snr(len(row_label)),
    )


def updated(config, dynamics, mixture, detections):
    """Return the mixture with each row's parent."""
    (radar,), forward = config.model.radars, new_engine(config).forward
    before = Updated(Branched(mixture, np.arange(len(mixture))), forward.factors)
    steps = GaussianSteps(dynamics, forward.bounds)
    found = update(before, View.of(radar, detections), steps, 6.0, 0)
    assert found.newborns == ()
    assert found.approximate == 0
    return found.rows


def alone(config, dynamics, mixture, detections):
    """Return what the weights of one hypothesis come to without and with one detection.

    They are relative to the probability that there is no target, and shape (1, R, S) or (2, R, S):
    the second is with the detection, if there is one.
    """
    found = updated(config, dynamics, mixture, detections).mixture
    nothing = detections.take(np.zeros(0, dtype=int))
    missed = updated(config, dynamics, mixture, nothing).mixture.mean[0]
    absent = 1.0 - mixture.weight.sum()
    weight = np.zeros((1 + len(detections), *mixture.weight.shape[1:]))
    for row in range(len(found)):
        weight[0 if np.array_equal(found.mean[row], missed) else 1] = found.weight[row]
    return weight * absent / (1.0 - found.weight.sum())


@pytest.mark.parametrize("targets", [2, 3])
@pytest.mark.parametrize("count", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", range(2))
def test_joint_weights_are_those_of_all_events_of_what_each_is_alone(targets, count, seed):
    rng = np.random.default_rng(seed)
    config = lone(GIVEN)
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    mixture = hypotheses(dynamics, targets, rng)
    place = radar.measure(MEAN[None]) + rng.standard_normal((count, 2)) * radar.noise_std
    every = Detections(place, rng.uniform(3.1, 4.0, count))
    missed, detected = [], []
    for row in range(len(mixture)):
        one = mixture.take(np.array([row]))
        missed.append(alone(config, dynamics, one, every.take(np.zeros(0, dtype=int)))[0])
        pairs = [alone(config, dynamics, one, every.take(np.array([z])))[1] for z in range(count)]
        detected.append(np.reshape(pairs, (count, one.weight.size)).T)
    shape = mixture.weight.shape
    target = mixture.sums.target.repeat(shape[1] * shape[2])
    expected = posterior(target, mixture.weight.ravel(), np.ravel(missed), np.concatenate(detected))

    branched = updated(config, dynamics, mixture, every)
    found = branched.mixture
    ways = np.column_stack([expected[0], expected[1]]).reshape(len(mixture), -1, count + 1)
    for row in range(len(mixture)):
        own = found.weight[branched.parent == row].reshape(-1, ways.shape[1])
        own = own[np.argsort(own.sum(axis=1))]
        expected_rows = ways[row].T[ways[row].sum(axis=0) > 0.0]
        expected_rows = expected_rows[np.argsort(expected_rows.sum(axis=1))]
        np.testing.assert_allclose(own, expected_rows, rtol=1e-9, atol=1e-15)
    existence = np.bincount(target, expected[0] + expected[1].sum(axis=1))
    np.testing.assert_allclose(found.sums.existence, existence, rtol=1e-9)


def test_detection_probabilities_of_the_joint_update_differ_by_gaussian():
    config = lone(GIVEN)
    dynamics = Dynamics(config.model)
    mixture = hypotheses(dynamics, 3, np.random.default_rng(0))
    nothing = Detections(np.zeros((0, 2)), np.zeros(0))
    share = np.array(
        [
            alone(config, dynamics, mixture.take(np.array([row])), nothing)[0] / mixture.weight[row]
            for row in range(len(mixture))
        ]
    )
    # The mean of some is beyond the radar's range, but hardly any is there altogether.
    seen = share.min(axis=(1, 2)) < 0.5
    assert 0 < seen.sum() < len(mixture)
    assert np.ptp(share[seen]) > 0.5
