from dataclasses import replace

import numpy as np
import pytest
from scenes import reference_scenario

from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.simulation.scenario import truth_at
from phd_jdtc_ros.simulation.simulate import detect, simulate, simulate_with_sources

SCENE = reference_scenario()
RADAR = SCENE.radars[1]


def standing(count, position=(6e3, 8e3)):
    """Return `count` equal targets at one place."""
    state = np.zeros((count, len(PLANAR)))
    state[:, [0, 2]] = position
    return Truth(1, state, np.arange(1, count + 1), np.zeros(count, dtype=int))


@pytest.mark.parametrize(
    ("scan", "tracks", "positions"),
    [
        (0, [1, 2, 3], [(-10e3, 10e3), (-10e3, -10e3), (-10e3, -10.5e3)]),
        (19, [1, 2, 3], [(-5896, 4984), (-5896, -4984), (-5896, -5484)]),
        (20, [1, 2, 3, 4], [(-5680, 4720), (-5680, -4720), (-5680, -5220), (1400, 8000)]),
        (59, [1, 2, 3, 4], [(2744, -5576), (2744, 5576), (2744, 5076), (1400, 3156.2)]),
        (60, [4], [(1400, 3032)]),
        (79, [4], [(1400, 672.2)]),
    ],
)
def test_truth_follows_the_script(scan, tracks, positions):
    truth = truth_at(SCENE, scan)
    np.testing.assert_array_equal(truth.track_id, tracks)
    np.testing.assert_allclose(truth.state[:, [0, 2]], positions, rtol=1e-12)


def test_truth_carries_class_and_velocity_at_exact_stamps():
    truth = truth_at(SCENE, 20)
    np.testing.assert_array_equal(truth.class_id, [0, 1, 0, 1])
    expected = [(36.0, -44.0), (36.0, 44.0), (36.0, 44.0), (0.0, -20.7)]
    np.testing.assert_array_equal(truth.state[:, [1, 3]], expected)
    np.testing.assert_array_equal(truth.state[:, 4], 0.0)
    truth = truth_at(replace(SCENE, targets=SCENE.targets[:3]), 70)
    assert truth.state.shape == (0, len(PLANAR))
    assert SCENE.stamp_ns(0) > 0
    assert SCENE.stamp_ns(79) == SCENE.stamp_ns(0) + 79 * 6_000_000_000
    third = replace(SCENE, interval_s=1.0 / 3.0)
    assert third.stamp_ns(3) == third.stamp_ns(0) + 10**9


@pytest.mark.parametrize("snr_db", [0.0, 10.0, 25.0, 45.0])
def test_detect_without_a_threshold_has_the_mean_square_of_the_snr(snr_db):
    snr, count = 10.0 ** (snr_db / 10.0), 40_000
    radar = replace(RADAR, threshold=0.0, clutter_rate=0.0)
    found = detect(standing(count), np.full(count, snr), radar, np.random.default_rng(0))[0]
    assert len(found) == count
    # a^2 is exponential, so its standard deviation is its mean.
    expected = 2.0 * (1.0 + snr)
    assert np.mean(found.amplitude**2) == pytest.approx(expected, rel=4.5 / np.sqrt(count))


def test_detect_reports_a_target_with_its_rayleigh_probability():
    snr, count = 10.0**1.5, 40_000
    radar = replace(RADAR, clutter_rate=0.0)
    found = detect(standing(count), np.full(count, snr), radar, np.random.default_rng(0))[0]
    chance = 1e-3 ** (1.0 / (1.0 + snr))
    error = 4.5 * np.sqrt(chance * (1.0 - chance) / count)
    assert abs(len(found) / count - chance) < error
    assert found.amplitude.min() > radar.threshold


def test_detect_clutter_is_poisson_noise_uniform_in_range_and_azimuth():
    radar = replace(RADAR, clutter_rate=20_000.0)
    found = detect(standing(0), np.zeros(0), radar, np.random.default_rng(0))[0]
    # Above the threshold a^2 = tau^2 + an exponential of mean 2.
    excess = found.amplitude**2 - radar.threshold**2
    assert excess.min() >= 0.0
    assert excess.mean() == pytest.approx(2.0, rel=4.5 / np.sqrt(len(found)))
    assert np.mean(excess > 4.0) == pytest.approx(np.exp(-2.0), abs=4.5 * 0.35 / 140.0)
    radar = replace(RADAR, clutter_rate=20_000.0)
    found = detect(standing(0), np.zeros(0), radar, np.random.default_rng(1))[0].measurement
    for column, low, width in ((0, 0.0, 15e3), (1, -np.pi, 2.0 * np.pi)):
        share = np.histogram((found[:, column] - low) / width, bins=10, range=(0.0, 1.0))[0]
        assert share.sum() == len(found)
        assert np.abs(share / len(found) - 0.1).max() < 4.5 * np.sqrt(0.09 / len(found))
    rng = np.random.default_rng(2)
    trials = 2000
    count = np.array([len(detect(standing(0), np.zeros(0), RADAR, rng)[0]) for _ in range(trials)])
    assert abs(count.mean() - 20.0) < 4.5 * np.sqrt(20.0 / trials)
    # Variance of a Poisson sample's variance: (2 m^2 + m) / n.
    assert abs(count.var() - 20.0) < 4.5 * np.sqrt((2.0 * 400.0 + 20.0) / trials)


def test_detect_noise_has_the_radar_covariance():
    count = 20_000
    radar = replace(RADAR, threshold=0.0, clutter_rate=0.0)
    found = detect(standing(count), np.full(count, 1e4), radar, np.random.default_rng(3))[0]
    error = found.measurement - radar.measure(standing(1).state)
    assert (np.abs(error.mean(axis=0)) < 4.5 * radar.noise_std / np.sqrt(count)).all()
    np.testing.assert_allclose(error.std(axis=0), radar.noise_std, rtol=4.5 / np.sqrt(2 * count))


def test_detect_sees_targets_within_the_range_beside_clutter():
    radar = replace(RADAR, visibility=Visibility(max_range=9e3), clutter_rate=0.0)
    found = detect(standing(100), np.full(100, 1e4), radar, np.random.default_rng(0))[0]
    assert len(found) == 0
    truth = standing(50)
    found = detect(truth, np.full(50, 1e4), RADAR, np.random.default_rng(0))[0]
    strong = np.flatnonzero(found.amplitude > 10.0)
    assert len(found) > len(strong) > 40
    assert strong.tolist() != list(range(len(strong)))


@pytest.mark.parametrize("position", [(-8e3, 0.0), (50.0, 0.0)], ids=["on-the-cut", "close"])
def test_detect_measurements_stay_in_their_domains(position):
    truth = standing(2000, position)
    found = detect(truth, np.full(2000, 1e4), RADAR, np.random.default_rng(0))[0].measurement
    assert found[:, 0].min() >= 0.0
    assert found[:, 1].min() > -np.pi
    assert found[:, 1].max() <= np.pi


def test_simulate_with_sources_labels_each_detection():
    run = simulate_with_sources(SCENE, 0)
    radar = SCENE.radars[0]
    misses = []
    for truth, scan, sources in run:
        for number, state in zip(truth.track_id, truth.state, strict=True):
            own = scan.detections[0].measurement[sources[0] == number]
            assert len(own) <= 1
            misses += [abs(row[0] - radar.measure(state[None])[0, 0]) for row in own]

    assert run[0][1].stamp_ns == simulate(SCENE, 0)[0][1].stamp_ns
    assert len(misses) > 150
    # The mean of |N(0, sigma)| is 0.8 sigma.
    assert np.mean(misses) == pytest.approx(0.8 * radar.range_std, rel=0.15)
