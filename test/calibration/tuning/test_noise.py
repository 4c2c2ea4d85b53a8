"""The noise and the revolutions of radars, found in plots."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plot_recordings import one_target, recorded
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.calibration.tuning import findings as estimation
from phd_jdtc_ros.calibration.tuning import linking, noise
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.calibration.tuning.noise import Noise, find_outliers, fit_noise
from phd_jdtc_ros.calibration.tuning.plots import (
    DENSE_CLOUDS,
    PlotRevolutions,
    Plots,
    Timing,
    limit_plots,
    plots_of,
    sectors,
    timing_of,
)
from phd_jdtc_ros.calibration.tuning.rates import clutter_rate, detection_probability, ends
from phd_jdtc_ros.calibration.tuning.tracks import LinkModel, Tracks, link_plots, log_ratio
from phd_jdtc_ros.core.types import Detections

GUESS = LinkModel(20.0, 0.01, (0.01, 1.0), 20.0, 0.9, 1.0)
NOISE_GUESS = Noise(20.0, 0.01, (0.01, 1.0), np.ones(2), 0)
SECONDS = Timing(2.0)
NS = 10**9
BEGIN_S = 20_779 * 86_400.0


def linked(plots):
    return link_plots(plots, SECONDS, GUESS, np.zeros(len(plots)))


def test_plots_are_bounded_in_number_and_time():
    plots = one_target(count=50, clutter=4)
    assert limit_plots(plots) is plots
    part = limit_plots(plots, 100)
    assert (len(part.cloud_s), len(part)) == (21, 105)
    assert len(limit_plots(plots, 15).cloud_s) == DENSE_CLOUDS
    plots = one_target(count=20)
    part = plots.until(10.0)
    assert isinstance(part, Plots)
    assert (len(part.cloud_s), len(part), part.duration_s) == (6, 6, 10.0)


@pytest.mark.parametrize("places", [False, True])
def test_steady_turn_does_not_pass_for_a_smaller_noise(places):
    rng, count = np.random.default_rng(6), 300
    course = np.radians(1.5) * 4.0 * np.arange(count)
    place = [9e3, 4e3] + 6e3 * np.stack([np.cos(course), np.sin(course)], axis=1)
    if not places:
        place = np.stack([np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])], axis=1)
    std = np.array([20.0, 20.0 if places else 0.004])
    measured = place + std * rng.standard_normal(place.shape)
    reports = [(k * 4 * NS, Detections(each[None], None)) for k, each in enumerate(measured)]
    plots, tracks = plots_of(reports, places), Tracks((np.arange(count),), 0.0)
    found = fit_noise(plots, tracks, NOISE_GUESS, 200.0, np.zeros(count))
    assert found.range_std < 0.7 * std[0]
    agreed = noise.agreeing(plots, tracks, found)
    assert [agreed.range_std, agreed.azimuth_std] == pytest.approx(std, rel=0.2)


def dense_clouds(seed):
    """Return forty clouds of 80 moving targets, detected with 0.9, and some 250 false plots."""
    rng, clouds = np.random.default_rng(seed), []
    place = np.stack([rng.uniform(-9e3, 9e3, 80), rng.uniform(-9e3, 9e3, 80)], axis=1)
    velocity = rng.normal(0.0, 15.0, (80, 2))
    for _ in range(40):
        place = place + 2.0 * velocity
        seen = place[rng.random(80) < 0.9]
        found = np.stack([np.hypot(*seen.T), np.arctan2(seen[:, 1], seen[:, 0])], axis=1)
        found += rng.standard_normal(found.shape) * [20.0, 0.01]
        count = rng.poisson(250)
        false = np.stack([rng.uniform(0.0, 12e3, count), rng.uniform(-3.1, 3.1, count)], axis=1)
        clouds.append(np.concatenate([found, false]))
    return recorded(clouds)


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_dense_plots_are_linked_in_one_sector_and_counted_all_around(monkeypatch, seed):
    most = 1500
    plots = limit_plots(dense_clouds(seed), most)
    assert len(plots.cloud_s) == DENSE_CLOUDS
    parts = list(sectors(plots, most))
    assert all(len(part) <= most for part, _ in parts)
    linked = np.concatenate([rows for _, rows in parts])
    assert len(np.unique(linked)) == len(linked)
    monkeypatch.setattr(estimation, "sectors", partial(sectors, most=most))
    found = findings(plots)
    assert found.tracks < 30
    assert found.noise.range_std == pytest.approx(20.0, rel=0.2)
    assert found.noise.azimuth_std == pytest.approx(0.01, rel=0.2)
    assert found.detection.value == pytest.approx(0.9, abs=0.04)
    # The 72 plots of targets in the other sectors hardly count as clutter.
    assert found.clutter.value == pytest.approx(250.0, rel=0.2)
    assert found.clutter.std > 5.0
    assert found.field.arc is None


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
        age = np.where(dies, -8, age + 1)  # Eight looks later the next one comes
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


def swept(rotation_s, seconds, per_s, wobble=0.0, seed=1, begin_s=0.0):
    """Return times, s, and azimuths of plots, ascending, of an antenna whose speed swings."""
    rng = np.random.default_rng(seed)
    time_s = np.sort(rng.uniform(begin_s, begin_s + seconds, round(seconds * per_s)))
    swing = wobble * 300.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time_s / 300.0))
    turned = (time_s + swing) / rotation_s
    azimuth = 2.0 * np.pi * (turned % 1.0)
    # Nothing is seen in the west.
    seen = (azimuth < 3.5) | (azimuth > 5.2)
    return time_s[seen], azimuth[seen]


def found(*plots):
    revolutions = PlotRevolutions()
    for time_s, azimuth in plots:
        for each_s, own in zip(time_s, azimuth, strict=True):
            revolutions.add(own, round((BEGIN_S + each_s) * NS))
    revolutions.find()
    return revolutions.revolution_s


@pytest.mark.parametrize(
    ("rotation_s", "per_s"), [(1.008, 5.0), (4.0016, 12.0), (7.63, 10.0), (12.03, 8.0)]
)
def test_revolution_of_an_even_antenna_is_exact(rotation_s, per_s):
    assert found(swept(rotation_s, 1200.0, per_s)) == pytest.approx(rotation_s, abs=1e-4)


@pytest.mark.parametrize(("rotation_s", "wobble"), [(1.008, 0.01), (4.0016, 0.005), (12.03, 0.005)])
def test_mean_revolution_of_an_antenna_that_wanders_is_found(rotation_s, wobble):
    # Whole periods, so that the mean of the revolutions is that of an even antenna.
    revolution_s = found(swept(rotation_s, 1800.0, 8.0, wobble))
    assert revolution_s == pytest.approx(rotation_s, rel=2e-4)


def test_revolution_is_followed_over_gaps_and_switches():
    plots = [swept(4.0016, 300.0, 12.0, seed=k, begin_s=1000.0 * k) for k in range(4)]
    assert found(*plots) == pytest.approx(4.0016, abs=1e-4)
    slow = swept(4.0016, 300.0, 12.0)
    fast = swept(2.5, 600.0, 12.0, begin_s=300.0)
    assert found(slow, fast) == pytest.approx(2.5, abs=1e-3)
    time_s, azimuth = swept(4.0016, 120.0, 12.0)
    time_s[5] += 3600.0
    assert found((time_s, azimuth)) == pytest.approx(4.0016, abs=1e-3)


def test_revolutions_are_known_after_a_minute_where_there_are_any():
    revolutions = PlotRevolutions()
    time_s, azimuth = swept(4.0016, 61.0, 12.0)
    for each_s, own in zip(time_s, azimuth, strict=True):
        revolutions.add(own, round(each_s * NS))
    assert revolutions.revolution_s == pytest.approx(4.0016, abs=0.01)
    assert found(swept(4.0, 30.0, 12.0)) == pytest.approx(4.0, abs=0.01)
    rng = np.random.default_rng(3)
    time_s = np.sort(rng.uniform(0.0, 600.0, 3000))
    assert found((time_s, rng.uniform(0.0, 2.0 * np.pi, 3000))) == 0.0
    time_s = np.arange(0.0, 300.0, 0.1)
    assert found((time_s, np.full(len(time_s), 1.0))) == 0.0


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("clockwise", [True, False])
def test_sectors_and_direction_are_those_of_the_antenna(timed, clockwise):
    rng, way = np.random.default_rng(1), -1.0 if clockwise else 1.0
    clouds, times_s = [], []
    for cloud in range(200):
        times_s.append(np.sort(rng.uniform(0.0, 0.25, 3)))
        azimuth = way * 2.0 * np.pi * (0.25 * cloud + times_s[-1]) / 3.0
        clouds.append(np.stack([rng.uniform(1e3, 9e3, 3), azimuth], axis=1))
    revolution = timing_of(recorded(clouds, 0.25, times_s if timed else None))
    assert revolution.rotation_s == pytest.approx(3.0, rel=3e-3)
    assert (revolution.sectors, revolution.clockwise) == (12, clockwise)


def test_no_more_sectors_are_proposed_than_are_allowed():
    # An antenna that turns in 3 s: each of the 300 plots of a revolution is a cloud.
    distance = np.random.default_rng(1).uniform(1e3, 9e3, (2000, 1))
    azimuth = -2.0 * np.pi * 0.01 * np.arange(2000).reshape(-1, 1) / 3.0
    clouds = np.stack([distance, azimuth], axis=2)
    plots = recorded(clouds, 0.01, [np.zeros(1)] * 2000)
    assert plots.timed
    assert timing_of(plots).rotation_s == pytest.approx(3.0, rel=3e-3)
    assert timing_of(plots).sectors == 0
    with pytest.raises(TuningError, match=r"about 300 clouds in a revolution of 3 s, must be"):
        findings(recorded(clouds, 0.01))


@pytest.mark.parametrize("clouds_of_a_look", [1, 2, 3])
def test_clouds_in_quick_succession_are_one_look(clouds_of_a_look):
    rng = np.random.default_rng(1)
    after_s = 2.0 * np.arange(40)[:, None] + 0.05 * np.arange(clouds_of_a_look)
    reports = [
        (round(each_s * NS), Detections(rng.uniform(1.0, 3.0, (4, 2)), None))
        for each_s in after_s.ravel()
    ]
    assert timing_of(plots_of(reports)).look_s == pytest.approx(2.0)


def test_repeated_clouds_are_left_out_if_chance_does_not_explain_them():
    once = [np.random.default_rng(1).uniform(1.0, 3.0, (size, 2)) for size in (6, 1, 6, 3)]
    twice = [place for place in once for _ in range(2)]
    assert len(recorded(twice, 0.05).cloud_s) == 4
    assert len(recorded(twice, 0.05)) == 16
    # Few coarse detections of targets at rest repeat by themselves.
    assert len(recorded([np.ones((2, 2))] * 20).cloud_s) == 20


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 6.0])
def test_targets_in_one_direction_are_no_turning_antenna(interval_s):
    rng = np.random.default_rng(1)
    clouds = np.stack([rng.uniform(1e3, 9e3, (150, 3)), rng.normal(1.0, 0.3, (150, 3))], axis=2)
    assert timing_of(recorded(clouds, interval_s)).rotation_s == 0.0
