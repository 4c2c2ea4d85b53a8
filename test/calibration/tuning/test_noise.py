"""Tracks of made plots, and the noise that is fitted to them."""

from dataclasses import replace

import numpy as np
import pytest
from plot_recordings import one_target, recorded
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.calibration.tuning import kinematics
from phd_jdtc_ros.calibration.tuning.levels import log_ratio
from phd_jdtc_ros.calibration.tuning.plots import Plots, limit_plots
from phd_jdtc_ros.calibration.tuning.rates import clutter_rate, detection_probability, ends
from phd_jdtc_ros.calibration.tuning.rotation import Timing
from phd_jdtc_ros.calibration.tuning.tracking import linking, noise
from phd_jdtc_ros.calibration.tuning.tracking.noise import Noise, find_outliers, fit_noise
from phd_jdtc_ros.calibration.tuning.tracking.tracks import LinkModel, Tracks, link_plots

GUESS = LinkModel(20.0, 0.01, (0.01, 1.0), 20.0, 0.9, 1.0)
SECONDS = Timing(2.0)


def linked(plots):
    return link_plots(plots, SECONDS, GUESS, np.zeros(len(plots)))


def test_plots_are_bounded_in_number_and_time():
    plots = one_target(count=50, clutter=4)
    assert limit_plots(plots) is plots
    part = limit_plots(plots, 100)
    assert (len(part.cloud_s), len(part)) == (21, 105)
    plots = one_target(count=20)
    part = plots.until(10.0)
    assert isinstance(part, Plots)
    assert (len(part.cloud_s), len(part), part.duration_s) == (6, 6, 10.0)


def test_one_target_is_one_track_through_misses():
    plots = one_target(missed={10, 11, 30}, clutter=3)
    found = linked(plots)
    assert len(found.plots) == 1
    own = found.plots[0]
    # Three of clutter follow each of the target's.
    assert np.isin(np.flatnonzero(np.diff(plots.cloud, prepend=-1)), own).sum() >= 55
    probability = detection_probability(plots, SECONDS, found)
    assert probability.value == pytest.approx(57 / 60, abs=0.03)
    assert clutter_rate(plots, SECONDS, found).value == pytest.approx(3.0, abs=0.15)
    # Only the plots that are not on land count, where a map of clutter is proposed.
    sea = np.arange(0, len(plots), 3)
    assert clutter_rate(plots, SECONDS, found, sea).value == pytest.approx(1.0, abs=0.05)


def test_plots_are_assigned_with_the_largest_score():
    rng = np.random.default_rng(5)
    for shape in [(1, 1), (3, 7), (7, 3), (6, 6), (0, 4), (4, 0)] * 20:
        score = rng.uniform(-5.0, 10.0, shape)
        score[rng.random(shape) < 0.3] = -np.inf
        column = linking.best_assignment(score)
        row = np.flatnonzero(column >= 0)
        assert len(np.unique(column[row])) == len(row)
        gain = np.maximum(score, 0.0)
        best = gain[linear_sum_assignment(gain, maximize=True)].sum()
        assert score[row, column[row]].sum() == pytest.approx(best, abs=1e-9)


def test_ends_of_tracks_are_those_of_targets_that_disappear():
    rng, death = np.random.default_rng(7), 0.01
    # Twenty targets at a time, a kilometre apart, of which each is followed by another one.
    age = np.zeros(20, dtype=np.int64)
    clouds, died = [], 0
    for _ in range(120):
        dies = rng.random(20) < death
        died += int(dies.sum())
        age = np.where(dies, -8, age + 1)  # eight looks later the next one comes
        seen = np.flatnonzero((age >= 0) & (rng.random(20) < 0.9))
        place = np.stack([2e3 + 1e3 * seen + 3.0 * age[seen], np.full(len(seen), 0.5)], axis=1)
        clouds.append(place + rng.standard_normal(place.shape) * [20.0, 0.01])
    plots = recorded(clouds)
    found = ends(plots, SECONDS, linked(plots))
    assert died > 15
    # Targets that disappear in the last looks may have been missed.
    assert died - 4 <= found.count <= died
    assert found.value == pytest.approx(died / (20 * 120), rel=0.25)
    assert found.std == pytest.approx(found.value / np.sqrt(found.count + 1), rel=1e-9)


def test_noise_is_found_from_far_away_and_its_deviation_is_honest():
    start = Noise(100.0, 0.002, (0.1, 1.0), np.ones(2), 0)
    off = []
    for seed in range(8):
        plots = one_target(seed=seed)
        whole = Tracks((np.arange(len(plots)),), 0.0)
        found = fit_noise(plots, whole, start, 20.0, np.zeros(len(plots)))
        logs = np.log([found.range_std / 20.0, found.azimuth_std / 0.01])
        off.append(logs / found.log_std)
    # Standard normal, sixteen of them.
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.6
    assert abs(np.mean(off)) < 1.0


def eight_targets(outliers, seed):
    """Return targets side by side, and their tracks; `outliers` have three times the noise."""
    rng, count, north, clouds = np.random.default_rng(seed), 60, 1e3 * np.arange(1, 9), []
    for cloud in range(count):
        east = 4000.0 - 20.0 * cloud
        place = np.stack([np.hypot(east, north), np.arctan2(north, east)], axis=1)
        scale = np.where(rng.random((8, 1)) < outliers, 3.0, 1.0) * [20.0, 0.01]
        clouds.append(place + scale * rng.standard_normal((8, 2)))
    rows = np.arange(8 * count).reshape(count, 8)
    return recorded(clouds), Tracks(tuple(rows.T), 0.0)


@pytest.mark.parametrize("seed", [10, 11])
def test_outliers_are_found_if_there_are_some(seed):
    start = Noise(20.0, 0.01, (1e-4, 1e-3), np.ones(2), 0)
    for share in (0.0, 0.2):
        plots, targets = eight_targets(share, seed)
        found = find_outliers(plots, targets, start, 20.0, np.zeros(len(plots)))
        assert (found is not None) == (share > 0.0)
    assert found.outliers
    assert found.range_std == pytest.approx(20.0, rel=0.2)
    assert found.azimuth_std == pytest.approx(0.01, rel=0.2)


def test_prediction_is_that_of_the_matrices():
    rng = np.random.default_rng(3)
    root = rng.standard_normal((5, 4, 4))
    mean, covariance = rng.standard_normal((5, 4)), root @ root.swapaxes(1, 2)
    dt, density = rng.uniform(0.5, 2.0, 5), rng.uniform(0.1, 1.0, 5)
    moved, grown = kinematics.predict(mean, covariance, dt, density)
    for k, step_s in enumerate(dt):
        step = np.eye(4) + step_s * np.eye(4, k=2)
        noise_of_axis = [[step_s**3 / 3.0, step_s**2 / 2.0], [step_s**2 / 2.0, step_s]]
        expected = step @ covariance[k] @ step.T + density[k] * np.kron(noise_of_axis, np.eye(2))
        np.testing.assert_allclose(moved[k], step @ mean[k])
        np.testing.assert_allclose(grown[k], expected)


def test_likelihood_of_one_motion_is_that_of_a_kalman_filter():
    """Of two plots far away, where a linear filter is the same."""
    plots = one_target(count=2)
    sequences = noise._sequences(plots, Tracks((np.arange(2),), 0.0), np.full(2, 30.0), 20.0)
    calm = np.array([[np.log(20.0), np.log(0.01), np.log(1e-6), noise.LEAST_RATIO]])
    (found,) = noise._log_likelihood(sequences, calm)
    first, second = plots.measurement
    mean, covariance = kinematics.initial_state(
        first, np.zeros(3), np.array([20.0**2, 0.01**2]), 20.0
    )
    mean, covariance = kinematics.predict(mean, covariance, np.array(2.0), np.array(0.0))
    expected, jacobian = kinematics.linearise(mean[:2], np.zeros(3))
    spread = jacobian @ covariance[:2, :2] @ jacobian.T + np.diag([20.0**2, 0.01**2])
    error = second - expected
    exact = -0.5 * error @ np.linalg.solve(spread, error)
    exact -= 0.5 * np.log(np.linalg.det(2.0 * np.pi * spread))
    assert found == pytest.approx(exact + np.log1p(-noise.CLUTTER_PROBABILITY), abs=1e-3)


def test_amplitudes_separate_targets_from_clutter_if_there_are_some():
    rng = np.random.default_rng(4)
    plots = one_target(count=60, clutter=1)
    first = np.diff(plots.cloud, prepend=-1) > 0
    amplitude = np.where(first, 30.0, rng.uniform(3.7, 6.0, len(plots)))
    plots = replace(plots, amplitude=amplitude)
    ratio = log_ratio(plots, plots, Tracks((np.flatnonzero(first),), 0.0))
    assert (ratio[first] > 3.0).all()
    assert (ratio[~first] < -2.0).all()
    assert not log_ratio(plots, plots, Tracks((), 0.0)).any()
