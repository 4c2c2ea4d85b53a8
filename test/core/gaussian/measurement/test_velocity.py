"""Measured velocities: the second update, births, and coarse likelihoods."""

from dataclasses import replace

import numpy as np
import pytest
from lone import GIVEN, MEAN, lone, mixture_of
from mast import mast
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.iterated_update import coarse_further, iterated_update
from phd_jdtc_ros.core.gaussian.measurement.newborn import newborn_mixture
from phd_jdtc_ros.core.gaussian.measurement.velocity import update_velocities
from phd_jdtc_ros.core.models.detection_birth import Newborn
from phd_jdtc_ros.core.sensors.gaussians import SPAN, HeightPrior, ReportedHeights
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

YAW, SPEED_STD, BIRTH_STD = 0.6, 0.4, 8.0
SENSOR = mast(3.0, yaw=YAW, velocity_model=VelocityModel(SPEED_STD))
MEASURING = np.eye(5)[[0, 2, 1, 3]]
TURN = np.array([[np.cos(YAW), np.sin(YAW)], [-np.sin(YAW), np.cos(YAW)]])
# Position and velocity in the sensor's frame, from x, y, vx and vy.
TO_SENSOR = np.block([[TURN, np.zeros((2, 2))], [np.zeros((2, 2)), TURN]])


def gaussians(rng, count):
    root = rng.standard_normal((count, 5, 5)) * np.array([9.0, 2.0, 8.0, 3.0, 0.1])[:, None]
    return MEAN + rng.standard_normal((count, 5)), root @ root.swapaxes(1, 2)


def test_position_and_velocity_in_turn_are_one_update_of_four_components():
    rng = np.random.default_rng(11)
    (mean,), (covariance,) = gaussians(rng, 1)
    dynamics = Dynamics(lone().model)
    mixture = mixture_of(dynamics, [(1.0, mean, np.ones(5))])
    mixture = mixture.changed(mean=mean[None, None], covariance=covariance[None, None])
    std, correlation, speed_std = np.array([[2.0, 5.0]]), np.array([0.6]), np.array([[0.3, 0.9]])
    seen = Detections(
        SENSOR.measure(mean[None]) + np.array([4.0, -3.0]),
        None,
        noise_std=std,
        noise_correlation=correlation,
        velocity=(mean[[1, 3]] + [0.5, -0.8])[None] @ TURN.T,
        velocity_std=speed_std,
    )
    update = iterated_update(mixture, np.array([0]), np.array([0]), View.of(SENSOR, seen))
    found, spread = update.updated_gaussians(mixture, np.array([0]), np.array([0]))

    noise = np.diag(np.concatenate([std[0], speed_std[0]]) ** 2)
    noise[0, 1] = noise[1, 0] = 0.6 * 2.0 * 5.0
    jacobian = TO_SENSOR @ MEASURING
    error = np.concatenate([[4.0, -3.0], TURN @ [0.5, -0.8]])
    total = jacobian @ covariance @ jacobian.T + noise
    gain = covariance @ jacobian.T @ np.linalg.inv(total)
    assert_allclose(found[0, 0], mean + gain @ error, rtol=5e-13)
    std = np.sqrt(np.diag(covariance))
    expected = covariance - gain @ total @ gain.T
    assert_allclose((spread[0, 0] - expected) / np.outer(std, std), 0.0, atol=5e-13)
    log_likelihood = multivariate_normal.logpdf(error, cov=total)
    assert_allclose(update.log_likelihood, [log_likelihood], rtol=5e-13)


@pytest.mark.parametrize("climb", [-1.3, None])
def test_place_and_velocity_in_space_in_turn_are_one_update_of_all_components(climb):
    rng = np.random.default_rng(12)
    root = rng.standard_normal((7, 7)) * np.array([9.0, 2.0, 8.0, 3.0, 0.1, 6.0, 1.5])[:, None]
    mean, covariance = np.append(MEAN, [40.0, 0.5]) + rng.standard_normal(7), root @ root.T
    model = VelocityModel(SPEED_STD)
    sensor = replace(
        SENSOR,
        height_prior=HeightPrior(50.0, 80.0, 0.0),
        reported_heights=ReportedHeights(1.7, garbled=0.0),
    )
    off = np.array([4.0, -3.0, 2.5, 0.5, -0.8, climb or 0.0])
    speed_std = np.array([0.3, 0.9, 0.6 if climb else model.UNKNOWN_STD])
    velocity = np.append((mean[[1, 3]] + off[3:5]) @ TURN.T, mean[6] + off[5])
    seen = Detections(
        sensor.measure(mean[None]) + off[:2],
        None,
        noise_std=np.array([[2.0, 5.0]]),
        noise_correlation=np.array([0.6]),
        velocity=velocity[None],
        velocity_std=speed_std[None],
        z=np.array([mean[5] + off[2]]),
    )
    dynamics = Dynamics(resolve({**GIVEN, "state": "space"}).model)
    mixture = mixture_of(dynamics, [(1.0, mean, np.ones(7))])
    mixture = mixture.changed(mean=mean[None, None], covariance=covariance[None, None])
    update = iterated_update(mixture, np.array([0]), np.array([0]), View.of(sensor, seen))
    found, spread = update.updated_gaussians(mixture, np.array([0]), np.array([0]))

    to_sensor = np.eye(6)
    to_sensor[:2, :2] = to_sensor[3:5, 3:5] = TURN
    jacobian = to_sensor @ np.eye(7)[[0, 2, 5, 1, 3, 6]]
    noise = np.diag(np.square([2.0, 5.0, 1.7, *speed_std]))
    noise[0, 1] = noise[1, 0] = 0.6 * 2.0 * 5.0
    error = np.concatenate([off[:3], TURN @ off[3:5], off[5:]])
    total = jacobian @ covariance @ jacobian.T + noise
    gain = covariance @ jacobian.T @ np.linalg.inv(total)
    std = np.sqrt(np.diag(covariance))
    assert_allclose((found[0, 0] - mean - gain @ error) / std, 0.0, atol=5e-13)
    expected = covariance - gain @ total @ gain.T
    assert_allclose((spread[0, 0] - expected) / np.outer(std, std), 0.0, atol=5e-13)
    # A height's likelihood is relative to the density of a garbled one.
    log_likelihood = multivariate_normal.logpdf(error, cov=total) + np.log(SPAN)
    assert_allclose(update.log_likelihood, [log_likelihood], rtol=5e-13)


def test_climb_of_unknown_speed_has_the_density_of_a_false_one():
    model = VelocityModel(SPEED_STD)
    density = model.log_density(np.zeros(1), np.array([[model.UNKNOWN_STD**2 + 3.0**2]]))
    assert_allclose(density, -np.log(model.span), atol=5e-3)


def test_unknown_velocity_changes_nothing():
    mean, covariance = gaussians(np.random.default_rng(2), 3)
    seen = Detections(np.zeros((3, 2)), None, velocity=np.array([[np.nan, 1.0]] * 3))
    found = update_velocities(mean, covariance, SENSOR.motion_of(seen))
    np.testing.assert_array_equal(found.mean, mean)
    assert_allclose(found.covariance, covariance, rtol=1e-15)
    np.testing.assert_array_equal(found.log_likelihood, np.zeros(3))


def test_coarse_likelihood_is_that_at_the_prediction():
    rng = np.random.default_rng(4)
    (mean,), (covariance,) = gaussians(rng, 1)
    mixture = mixture_of(Dynamics(lone().model), [(1.0, mean, np.ones(5))])
    mixture = mixture.changed(mean=mean[None, None], covariance=covariance[None, None])
    velocity = np.array([mean[[1, 3]] + [3.0, -2.0], [np.nan, 0.0]]) @ TURN.T
    report = View.of(SENSOR, Detections(np.zeros((2, 2)), None, velocity=velocity))
    found = coarse_further(mixture, np.array([0, 0]), np.array([0, 1]), report)
    spread = covariance[np.ix_([1, 3], [1, 3])] + SPEED_STD**2 * np.eye(2)
    assert_allclose(found, [[multivariate_normal.logpdf([3.0, -2.0], cov=spread)], [0.0]])
    without = View.of(mast(), report.detections)
    assert coarse_further(mixture, np.array([0]), np.array([0]), without) is None


def test_target_is_born_with_its_velocity():
    births = {"detection_births.rates": [0.05], "detection_births.std": [BIRTH_STD, 2e-3]}
    model = lone({**GIVEN, **births}).model
    world = np.array([[3.0, -4.0], [np.nan, np.nan]])
    seen = Detections(np.zeros((2, 2)), None, velocity=world @ TURN.T)
    report = View.of(SENSOR, seen)
    found = newborn_mixture(Newborn(report, np.ones((2, 1)), np.arange(2)), Dynamics(model), 7)
    share = BIRTH_STD**2 / (BIRTH_STD**2 + SPEED_STD**2)
    assert_allclose(found.mean[0, 0, [1, 3]], share * world[0], rtol=1e-9)
    assert_allclose(found.covariance[0, 0, [1, 3], [1, 3]], share * SPEED_STD**2, rtol=1e-9)
    assert_allclose(found.covariance[1, 0, [1, 3], [1, 3]], BIRTH_STD**2, rtol=1e-9)
    # A velocity does not tell a new target from a false detection.
    known, unknown = model.detection_births.log_intensity(report, model.modes, 6.0)[0]
    assert_allclose(known - unknown, report.log_clutter[0] - report.log_clutter[1], rtol=1e-9)
