"""The Gaussian engine with other sensors than polar radars, compiled and in array operations."""

from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from lone import (
    GIVEN,
    INTERVAL_S,
    MEAN,
    SIZE,
    TWO_MOTIONS,
    lone,
    path,
    scan_at,
    started,
)
from mast import REACH, LinearisedPositions, mast
from scipy.stats import multivariate_normal, norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.core.sensors.gaussians import PlanePlots, noise_covariance
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import (
    Linearised,
    Measured,
    WeightedGaussians,
)
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.position import PositionSensor
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

SECONDS = INTERVAL_S * np.arange(1.0, 9.0)
STD, CLUTTER = 30.0, 4


class LinearisedRadar(RadarModel):
    """A radar whose measurements of Gaussians are those of the base class, in array operations."""

    @property
    def of_gaussians(self):
        return Linearised(self)


def with_sensor(config, sensor):
    return replace(config, model=replace(config.model, radars=(sensor,)))


def smoothed(engine):
    """Return the smoothed mixtures of an engine's window, oldest first."""
    return backward_pass(engine._window)[::-1]


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "at their own times"])
def test_linearised_radar_gives_the_mixtures_of_the_compiled_one(monkeypatch, timed):
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))
    config = lone({**TWO_MOTIONS, "radar.clutter_rate": 3.0})
    (radar,) = config.model.radars
    columns = {each.name: getattr(radar, each.name) for each in fields(radar)}
    rng = np.random.default_rng(5)
    engines = [started(config), started(with_sensor(config, LinearisedRadar(**columns)))]
    for seconds, state in zip(SECONDS, path(SECONDS, 0.01), strict=True):
        # Near the target, so that every plot is in its gate.
        near = radar.measure(state[None]) + 3.0 * radar.noise_std * rng.standard_normal((3, 2))
        time_s = rng.uniform(-1.0, 0.0, 3) if timed else None
        for engine in engines:
            engine.step(scan_at(seconds, near, time_s=time_s))
    for compiled, other in zip(*map(smoothed, engines), strict=True):
        np.testing.assert_array_equal(other.row_label, compiled.row_label)
        np.testing.assert_allclose(other.weight, compiled.weight, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(other.mean, compiled.mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(other.covariance, compiled.covariance, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "at their own times"])
def test_compiled_positions_give_the_mixtures_of_array_operations(timed):
    config, rng = lone(TWO_MOTIONS), np.random.default_rng(5)
    turned = {"yaw": 0.7, "velocity_model": VelocityModel(2.0)}
    sensors = [mast(STD, kind, **turned) for kind in (PositionSensor, LinearisedPositions)]
    engines = [started(with_sensor(config, sensor)) for sensor in sensors]
    for seconds, state in zip(SECONDS, path(SECONDS, 0.01), strict=True):
        near = sensors[0].measure(state[None]) + 3.0 * STD * rng.standard_normal((4, 2))
        velocity = np.array([30.0, -30.0]) + 5.0 * rng.standard_normal((4, 2))
        velocity[0] = np.nan
        own = {
            "time_s": rng.uniform(-1.0, 0.0, 4) if timed else None,
            "noise_std": rng.uniform(0.5 * STD, 2.0 * STD, (4, 2)),
            "noise_correlation": np.array([0.8, -0.5, np.nan, 0.0]),
            "velocity": velocity,
        }
        for engine in engines:
            engine.step(scan_at(seconds, near, **own))
    for compiled, other in zip(*map(smoothed, engines), strict=True):
        np.testing.assert_array_equal(other.row_label, compiled.row_label)
        np.testing.assert_allclose(other.weight, compiled.weight, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(other.mean, compiled.mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(other.covariance, compiled.covariance, rtol=1e-6, atol=1e-6)


def test_target_born_at_positions_is_tracked_more_exactly_than_measured():
    births = {"detection_births.rates": [0.05]}
    sensor = mast(STD)
    engine = new_engine(with_sensor(lone({**GIVEN, **births, "lag": len(SECONDS)}), sensor))
    rng, states, plots = np.random.default_rng(7), path(SECONDS), []
    for seconds, state in zip(SECONDS, states, strict=True):
        plots.append(sensor.measure(state[None]) + STD * rng.standard_normal((1, 2)))
        false = rng.uniform(-REACH, REACH, (CLUTTER, 2))
        engine.step(scan_at(seconds, np.concatenate([plots[-1], false])))
    found = engine.flush()
    assert [len(estimates) for estimates in found] == [1] * len(SECONDS)
    estimated = np.concatenate([estimates.position for estimates in found])
    measured = sensor.to_world(np.concatenate(plots))
    truth = states[:, [0, 2]]
    assert np.square(estimated - truth).mean() < 0.7 * np.square(measured - truth).mean()
    assert np.hypot(*(found[-1].velocity[0] - MEAN[[1, 3]])) < 10.0


@pytest.mark.parametrize("kind", [PositionSensor, LinearisedPositions])
def test_correlated_errors_of_positions_update_as_in_a_kalman_filter(kind):
    sensor, std, correlation = mast(sensor=kind), np.array([[10.0, 40.0]]), np.array([0.8])
    place = np.eye(SIZE)[[0, 2]]
    root = np.random.default_rng(3).standard_normal((5, 5)) * [[20.0], [2.0], [30.0], [3.0], [0.01]]
    mean, covariance = MEAN, root @ root.T
    noise = np.array([[100.0, 320.0], [320.0, 1600.0]])
    measured = place @ mean - sensor.position + [15.0, -25.0]
    seen = Detections(measured[None], None, noise_std=std, noise_correlation=correlation)
    np.testing.assert_allclose(
        noise_covariance(sensor.noise_std_of(seen), correlation), noise[None]
    )
    np.testing.assert_allclose(PlanePlots.of(measured[None], noise[None]).covariance, noise[None])
    prior = mean[None], covariance[None]
    alone = Measured(measured[None], std, correlation)
    found = kalman.innovations(WeightedGaussians.of(*prior), sensor, alone)
    total = place @ covariance @ place.T + noise
    gain = covariance @ place.T @ np.linalg.inv(total)
    later = kalman.update(*prior, sensor, found, None)
    np.testing.assert_allclose(later[0][0], mean + gain @ [15.0, -25.0])
    np.testing.assert_allclose(later[1][0], covariance - gain @ place @ covariance, atol=1e-9)
    expected = multivariate_normal.logpdf([15.0, -25.0], cov=total)
    np.testing.assert_allclose(found.log_likelihood, expected)
    gaussians = sensor.of_gaussians
    predicted = gaussians.expected(mean[None, None], covariance[None, None])
    report = View.of(sensor, seen)
    *_, gated = gaussians.gate_pairs(np.ones((1, 1)), mean[None, None], predicted, report)
    np.testing.assert_allclose(gated, [[expected]])


class EastSensor(LinearisedPositions):
    """Measures the first coordinate of a position alone."""

    @property
    def noise_std(self):
        return np.array(self.std[:1])

    def linearise(self, position):
        position, jacobian = super().linearise(position)
        return position[..., :1], jacobian[..., :1, :]


def test_one_component_updates_as_in_a_kalman_filter():
    sensor, covariance = mast(STD, EastSensor), np.diag(STD**2 * np.arange(1.0, SIZE + 1.0))
    covariance[0, 1] = covariance[1, 0] = 0.5 * STD**2
    prior, measured = (MEAN[None], covariance[None]), MEAN[:1] - sensor.position[0] + 15.0
    seen = Measured(measured[None], sensor.noise_std[None])
    found = kalman.innovations(WeightedGaussians.of(*prior), sensor, seen)
    mean, later = kalman.update(*prior, sensor, found)
    gain = covariance[0] / (covariance[0, 0] + STD**2)
    np.testing.assert_allclose(mean[0], MEAN + 15.0 * gain)
    np.testing.assert_allclose(later[0], covariance - np.outer(gain, covariance[0]), atol=1e-9)
    expected = norm.logpdf(15.0, scale=np.sqrt(covariance[0, 0] + STD**2))
    np.testing.assert_allclose(found.log_likelihood, expected)


def test_sensor_of_positions_updates_targets_without_detections():
    engine = started(with_sensor(lone(), mast(STD)))
    engine.step(scan_at(SECONDS[0], np.zeros((0, 2))))
    (mixture,) = smoothed(engine)[-1:]
    expected = MEAN[0] + SECONDS[0] * MEAN[1]
    np.testing.assert_allclose(mixture.mean[0, 0, 0], expected)
