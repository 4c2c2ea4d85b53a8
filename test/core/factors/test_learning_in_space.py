"""What is learned of a radar in space: its noise, its outliers, and fixed clutter."""

import math

import numpy as np
import pytest
from dome import SPACE, nees, paths, scan, seen
from lone import lone

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import Outliers
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.algebra.heavy_tails import mix_noises
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import Detections

SIZE = len(SPATIAL)


@pytest.mark.parametrize("unknown", [False, True], ids=["elevation", "no elevation"])
def test_mixed_innovation_has_the_moments_of_both_noises(unknown):
    (radar,) = lone(SPACE).model.radars
    rng, outliers = np.random.default_rng(0), Outliers(start=0.1, ratio=4.0)
    mean = np.array([[3000.0, 30.0, 2000.0, -20.0, 0.01, 1200.0, 3.0]])
    root = rng.normal(size=(SIZE, SIZE)) * [[40.0], [5.0], [50.0], [4.0], [0.01], [60.0], [2.0]]
    covariance = (root @ root.T)[None]
    measured = radar.measure(mean) + np.array([60.0, 0.03, -0.04])
    std = radar.noise_std[None].copy()
    if unknown:
        measured[0, 2], std[0, 2] = 0.0, UNKNOWN_STD
    gaussians = WeightedGaussians.of(mean, covariance)

    def updated(noise_std):
        # One linearisation, so that both noises have the same Jacobian.
        given = Measured(measured, noise_std)
        found = kalman.innovations(gaussians, radar, given, iterations=1)
        return found, kalman.update(mean, covariance, radar, found)

    wide_std = std * np.array([4.0, 4.0, 1.0 if unknown else 4.0])
    (usual, own), (wide, other) = updated(std), updated(wide_std)
    log = np.array([usual.log_likelihood[0], wide.log_likelihood[0]])
    log += np.log([1.0 - outliers.share, outliers.share])
    share = np.exp(log - np.logaddexp(*log))
    mixed, outlier = mix_noises(usual, outliers, std, None, np.array([0]))
    later_mean, later = kalman.update(mean, covariance, radar, mixed)
    assert outlier[0] == pytest.approx(share[1], rel=1e-9)
    assert mixed.log_likelihood[0] == pytest.approx(np.logaddexp(*log), rel=1e-9)
    means = np.stack([own[0][0], other[0][0]])
    right = share @ means
    apart = means - right
    spread = np.tensordot(share, np.stack([own[1][0], other[1][0]]), axes=1)
    spread += np.einsum("k,ki,kj->ij", share, apart, apart)
    scale = np.sqrt(np.diag(covariance[0]))
    np.testing.assert_allclose((later_mean[0] - right) / scale, 0.0, atol=1e-9)
    np.testing.assert_allclose((later[0] - spread) / np.outer(scale, scale), 0.0, atol=1e-8)


@pytest.mark.parametrize("ratio", [0.6, 1.6])
def test_noise_of_elevations_is_learned_and_heights_are_as_certain_as_said(ratio):
    given = {**SPACE, "radar.learn": ["noise"]}
    given["radar.elevation_std_deg"] = SPACE["radar.elevation_std_deg"] / ratio
    config, squares = lone(given), []
    (true,) = lone(SPACE).model.radars
    rng = np.random.default_rng(30)
    truth, engine = paths(config, rng), new_engine(config)
    for index, state in enumerate(truth):
        detected = state[rng.random(len(state)) < 0.9]
        step = engine.step(scan(index, seen(true, detected, rng, missing=0.2)))
        if index > 12:
            squares += nees(step.filtered[0], state)
    figures = engine.forward.learned_figures
    found = figures["radar.elevation_noise_ratio"]
    assert found == pytest.approx(ratio, abs=4.0 * figures["radar.elevation_noise_ratio_std"])
    assert found == pytest.approx(ratio, rel=0.12)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_share_of_outliers_is_learned_and_heights_are_as_certain_as_said():
    rng, squares = np.random.default_rng(31), []
    config = lone({**SPACE, "radar.learn": ["outliers"]})
    (radar,) = config.model.radars
    truth, engine = paths(config, rng), new_engine(config)
    for index, state in enumerate(truth):
        report = seen(radar, state, rng)
        wide = rng.random(len(state)) < 0.1
        measured = report.measurement.copy()
        measured[wide] += 4.0 * radar.noise_std * rng.standard_normal((wide.sum(), 3))
        report = report.changed(measurement=measured)
        found = engine.step(scan(index, report)).filtered[0]
        if index > 10:
            squares += nees(found, state)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)
    assert 0.06 < engine.forward.learned_figures["radar.outlier_share"] < 0.15


def test_reflectors_are_learned_as_clutter_in_space():
    given = {
        **SPACE,
        "radar.clutter_map": True,
        "radar.clutter_map_speed": 2.0,
        "radar.clutter_rate": 5.0,
    }
    config, rng = lone(given), np.random.default_rng(32)
    (radar,) = config.model.radars
    turns = rng.uniform(0.0, 2.0 * math.pi, 12)
    fixed = np.column_stack([rng.uniform(2e3, 9e3, 12), turns, np.full(12, 0.002)])
    target = np.zeros((1, SIZE))
    target[0, [0, 1, 2, 3, 5]] = 6e3, -40.0, 4e3, 20.0, 900.0
    engine, reported = new_engine(config), []
    for index in range(60):
        shown = np.concatenate([fixed[rng.random(12) < 0.8], radar.measure(target)])
        noisy = shown + radar.noise_std * rng.standard_normal(shown.shape)
        noisy = radar.wrap(noisy)
        reported.append(engine.step(scan(index, Detections(noisy, None))).filtered[0])
        target[0, [0, 2]] += target[0, [1, 3]]
    assert [len(each) for each in reported[-10:]] == [1] * 10
    assert abs(reported[-1].state[0, 5] - 900.0) < 150.0
    assert engine.forward.factors.clutter_raster(config.model.radars) is not None
