"""Targets in space: updates against textbooks, consistency, births and the edges of the beam."""

from dataclasses import replace

import numpy as np
import pytest
from dome import SPACE, TWO_SLANT_RANGES, nees, paths, scan, seen
from lone import MEAN, lone, mixture_of

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman, range_rate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.state_space import SPATIAL

SIZE = len(SPATIAL)

PLACE, MOTION = list(SPATIAL.place), list(SPATIAL.motion)


@pytest.mark.parametrize("time_s", [0.0, 0.8])
def test_update_is_that_of_a_kalman_filter_with_the_last_linearisation(time_s):
    (radar,) = lone(SPACE).model.radars
    rng = np.random.default_rng(0)
    mean = np.array([3000.0, 30.0, 2000.0, -20.0, 0.01, 1200.0, 3.0])
    root = rng.normal(size=(SIZE, SIZE)) * [[40.0], [5.0], [50.0], [4.0], [0.01], [60.0], [2.0]]
    covariance = root @ root.T
    back = np.eye(SIZE)
    back[PLACE, MOTION] = time_s
    measured = radar.measure((back @ mean)[None]) + np.array([12.0, -0.01, 0.02])
    noise, times = np.diag(radar.noise_std**2), np.array([time_s])
    given = Measured(measured, radar.noise_std[None], None, times)
    gaussians = WeightedGaussians.of(mean[None], covariance[None])
    found = kalman.innovations(gaussians, radar, given, converged=0.0, iterations=30)
    later = kalman.update(mean[None], covariance[None], radar, found, times)

    at, prior, spread = back @ mean, back @ mean, back @ covariance @ back.T
    for _ in range(30):
        expected, slope = radar.linearise(at[PLACE])
        seen_of = np.zeros((3, SIZE))
        seen_of[:, PLACE] = slope
        total = seen_of @ spread @ seen_of.T + noise
        gain = spread @ seen_of.T @ np.linalg.inv(total)
        error = radar.wrap(measured[0] - expected) - slope @ (prior - at)[PLACE]
        at = prior + gain @ error
    home = np.linalg.inv(back)
    right = home @ (spread - gain @ seen_of @ spread) @ home.T
    std = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((later[0][0] - home @ at) / std, 0.0, atol=1e-7)
    np.testing.assert_allclose((later[1][0] - right) / np.outer(std, std), 0.0, atol=1e-7)
    log_likelihood = -0.5 * (
        error @ np.linalg.solve(total, error) + np.log(np.linalg.det(2.0 * np.pi * total))
    )
    assert found.log_likelihood[0] == pytest.approx(log_likelihood, abs=1e-6)


@pytest.mark.parametrize("time_s", [None, 0.3])
def test_expected_range_rate_has_the_moments_of_drawn_states(time_s):
    (radar,) = lone(SPACE).model.radars
    radar = radar.changed(range_rate=RangeRateModel(0.1, 0.0), velocity=(5.0, -3.0))
    rng = np.random.default_rng(2)
    mean = np.array([[620.0, -14.0, -180.0, 9.0, 0.0, 150.0, 4.0]])
    std = np.array([4.0, 5.0, 4.0, 5.0, 0.0, 5.0, 3.0])
    mixing = np.eye(SIZE) + 0.4 * np.eye(SIZE, k=1)
    root = mixing * std
    drawn = mean + rng.standard_normal((10**6, SIZE)) @ root.T
    times = None if time_s is None else np.array([time_s])
    drawn_times = None if time_s is None else np.full(len(drawn), time_s)
    found = range_rate.expected_rates(mean, (root @ root.T)[None], radar, times)
    rates = radar.range_rate_of(drawn, drawn_times)
    assert found.rate[0] == pytest.approx(rates.mean(), abs=0.02)
    assert found.variance[0] == pytest.approx(rates.var(), rel=0.01)
    cross = ((drawn - mean) * (rates - rates.mean())[:, None]).mean(axis=0)
    scale = np.maximum(np.sqrt(np.diag(root @ root.T) * rates.var()), 1e-9)
    np.testing.assert_allclose((found.cross[0] - cross) / scale, 0.0, atol=0.01)


@pytest.mark.parametrize("missing", [0.0, 0.3], ids=["all elevations", "some unknown"])
def test_heights_are_as_certain_as_said(missing):
    config, squares, smoothed = lone(SPACE), [], []
    (radar,) = config.model.radars
    for rng in map(np.random.default_rng, range(20, 24)):
        truth, engine = paths(config, rng), new_engine(config)
        for index, state in enumerate(truth):
            detected = state[rng.random(len(state)) < 0.9]
            step = engine.step(scan(index, seen(radar, detected, rng, missing)))
            if index >= 10:
                squares += nees(step.filtered[0], state)
                smoothed += nees(step.smoothed[0], truth[index - 5])
    for found in (squares, smoothed):
        assert len(found) > 2000
        assert np.mean(found) == pytest.approx(1.0, abs=0.15)


def test_two_slant_ranges_find_heights_and_one_does_not():
    config, rng = lone(TWO_SLANT_RANGES), np.random.default_rng(3)
    state = np.zeros((1, SIZE))
    state[0] = [4500.0, -40.0, 5000.0, 25.0, 0.0, 2200.0, 3.0]
    both, alone = new_engine(config), new_engine(config)
    for index in range(25):
        reports = [seen(radar, state, rng) for radar in config.model.radars]
        found = both.step(scan(index, *reports)).filtered[0]
        single = alone.step(scan(index, reports[0], None)).filtered[0]
        true, state = state[0].copy(), state + 0.0
        state[:, PLACE] += state[:, MOTION]
    assert len(found) == len(single) == 1
    std = np.sqrt(found.covariance[0, 5, 5])
    assert std < 100.0
    assert abs(found.state[0, 5] - true[5]) < 4.0 * std
    assert found.attributes.height[0, 0] == found.state[0, 5]
    # Of one slant range a height comes out as wide as the prior, and is not reported.
    assert np.sqrt(single.covariance[0, 5, 5]) > 500.0
    assert np.isnan(single.attributes.height).all()
    assert np.isnan(single.attributes.height_covariance).all()
    # One radar alone finds none, however narrow a height has become.
    one = lone({**SPACE, "radar.fields.elevation": ""}).model
    assert np.isnan(found.with_heights(one.largest_height_std).attributes.height).all()
    assert config.model.largest_height_std > std


def test_range_rates_without_elevations_make_no_height_more_certain_than_it_is():
    own = {
        **{"fields.elevation": "", "fields.range_rate": "range_rate", "range_rate_std": 0.2},
        **{"position": [0.0, 0.0, 0.0], "range_std": 1.5, "azimuth_std_deg": 0.8},
    }
    near = {"height_prior": [200.0, 150.0, 0.0], "detection_births.std": [10.0, 0.001, 5.0]}
    near |= {"interval_s": 0.2, "cv.vertical_noise_density": 0.1}
    config = lone({**SPACE, **near, **{f"radar.{name}": value for name, value in own.items()}})
    (radar,), rng, squares = config.model.radars, np.random.default_rng(31), []
    state, angle = np.zeros((12, SIZE)), 2.0 * np.pi * np.arange(12) / 12
    state[:, 0], state[:, 2] = 800.0 * np.cos(angle), 800.0 * np.sin(angle)
    state[:, 5] = rng.uniform(100.0, 350.0, 12)
    state[:, MOTION] = rng.normal(0.0, [8.0, 8.0, 1.5], (12, 3))
    engine = new_engine(config)
    for index in range(100):
        rate = radar.range_rate_of(state) + rng.normal(0.0, 0.2, 12)
        report = seen(radar, state, rng, missing=1.0).changed(range_rate=rate)
        step = engine.step(scan(0.2 * index, report))
        squares += nees(step.filtered[0], state) if index >= 70 else []
        state[:, PLACE] += 0.2 * state[:, MOTION]
    assert len(squares) > 300
    # Their median is 0.45, and their quantile of 90 % 2.7, if the deviations are right.
    assert np.median(squares) < 1.0
    assert np.quantile(squares, 0.9) < 6.0


def test_target_that_leaves_the_beam_above_is_soon_outside():
    config, rng = lone(SPACE), np.random.default_rng(5)
    (radar,) = config.model.radars
    radar = radar.changed(visibility=replace(radar.visibility, elevations=(-0.03, 0.3)))
    config = replace(config, model=config.model.changed(radars=(radar,)))
    engine, state = new_engine(config), np.zeros((1, SIZE))
    state[0, PLACE], state[0, MOTION] = [4500.0, -300.0, 1000.0], [-60.0, 0.0, 4.0]
    outside = []
    for index in range(60):
        expected = radar.measure(state)[0]
        visible = expected[2] < 0.3
        step = engine.step(scan(index, seen(radar, state if visible else state[:0], rng)))
        outside += [] if visible else [len(step.filtered[0])]
        state[:, PLACE] += state[:, MOTION]
    assert len(outside) > 20
    # It coasts beyond the edge, as one does beyond the largest range, and ends.
    assert outside[0] == 1
    assert outside[-1] == 0
    (motion,) = config.model.modes.motions
    assert motion.support == (0, 1, 2, 3, 5, 6)


def test_predicted_states_climb_and_keep_their_covariances_apart():
    dynamics = Dynamics(lone(SPACE).model)
    (motion,) = dynamics.motions
    state = np.array([[*MEAN[:4], 0.0, 900.0, -3.0]])
    later = motion.mean(state, 2.0)
    assert later[0, 5:].tolist() == [894.0, -3.0]
    np.testing.assert_allclose(motion.jacobian(state, 2.0)[0] @ state[0], later[0])
    noise = motion.noise_covariance(2.0)
    np.testing.assert_allclose(noise[4:, 4:], 2.0 * np.array([[8 / 3, 2.0], [2.0, 2.0]]))
    assert not noise[:4, 4:].any()
    assert mixture_of(dynamics, [(0.5, state[0], np.ones(SIZE))]).covariance[0, 0, 5, 5] == 1.0


@pytest.mark.parametrize(
    ("start", "velocity"),
    [
        ([470.0, -300.0, 180.0], [2.0, 0.0, 0.0]),  # Over the antenna
        ([3e3, 0.0, -400.0], [10.0, 0.0, 0.0]),  # Below the floor of the prior
        ([500.0, -299.0, 31.0], [0.0, 0.3, 0.1]),  # Beside the antenna
    ],
    ids=["overhead", "below the floor", "at the antenna"],
)
def test_targets_at_odd_places_are_finite_and_one(start, velocity):
    given = {**SPACE, "radar.fov_elevation_deg": [-90.0, 90.0], "radar.detection_probability": 0.95}
    config, rng = lone(given), np.random.default_rng(7)
    (radar,), state = config.model.radars, np.zeros((1, SIZE))
    state[0, PLACE], state[0, MOTION] = start, velocity
    engine, near = new_engine(config), []
    for index in range(30):
        found = engine.step(scan(index, seen(radar, state, rng, missing=0.2))).filtered[0]
        assert np.isfinite(found.state).all()
        assert np.isfinite(found.covariance).all()
        if index > 10:
            near.append(len(found) and np.linalg.norm(found.state[:, PLACE] - state[0, PLACE]))
        state[:, PLACE] += state[:, MOTION]
    assert len(found) == 1
    assert np.median(near) < 40.0


def test_heights_that_no_target_has_are_taken_as_garbled():
    config, rng = lone({**SPACE, "radar.fields.height": "height"}), np.random.default_rng(8)
    (radar,) = config.model.radars
    truth, engine = paths(config, rng, targets=5, scans=15), new_engine(config)
    for index, state in enumerate(truth):
        absurd = np.array([-5e3, 1e5, 0.0, 3e4, np.nan])
        report = seen(radar, state, rng).changed(z=absurd)
        found = engine.step(scan(index, report)).filtered[0]
    assert len(found) == 5
    assert np.mean(nees(found, truth[-1])) < 4.0
