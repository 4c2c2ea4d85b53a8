from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reference import resolve
from scenario_blocks import exact
from scenes import reference_scenario

from phd_jdtc_ros.core.sensors.visibility import Visibility, sector_probability
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import UNKNOWN, Coverage, Truth
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.antenna import Antenna
from phd_jdtc_ros.simulation.scenario import truth_at
from phd_jdtc_ros.simulation.simulate import detect, simulate, simulate_with_sources
from phd_jdtc_ros.simulation.turning_antenna import (
    TurningRadar,
    plots_with_replies,
    simulate_reports,
)

SCENE = reference_scenario()
RADAR = SCENE.radars[1]
PARAMETERS = {
    **exact("hill", 300e3, geodetic=[50.0, 8.5, 130.0], rotation_s=4.0),
    "world_origin": [50.0, 8.5, 100.0],
    "hill.fields.height": "height",
    "hill.fields.amplitude": "",
    "classes": ["aircraft"],
    "births": [],
}
MIRROR = {"position": [3000.0, 4000.0], "probability": 1.0}
# Height of the target above the antenna, metres.
ABOVE = 100.0 + 5000.0 - 130.0
# The flight leads from the south over the radar to the north, at 5 km.
OVERHEAD = {
    "class_id": 0,
    "position": [10.0, -60e3],
    "velocity": [0.0, 200.0],
    "height": 5000.0,
    "legs": [{"duration_s": 600.0}],
}
CONFIG = resolve(
    {
        "sensors": ["one", "other"],
        **{
            f"{name}.{key}": value
            for name in ("one", "other")
            for key, value in {
                "rotation_s": 4.0,
                "fields.time": "time",
                "fields.amplitude": "",
                "max_range": 1e5,
                "clutter_max_range": 1e5,
            }.items()
        },
    }
)
DOCUMENT = {"interval_s": 1.0, "scans": 25, "traffic": {"aircraft": 5, "seed": 3}}
ERRORS = {"range_bias": 80.0, "range_gain": 1e-3, "azimuth_bias_deg": 0.3, "time_offset_s": 0.5}
ROTATION_S = 4.0016
WINDY = Antenna(bearing=1.0, wobble=0.005, wobble_period_s=700.0)
TIMES = np.linspace(0.0, 3600.0, 5000)


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
    # The standard deviation of a^2 is its mean, because it is exponential.
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


def test_detect_sees_neither_targets_nor_clutter_in_a_blind_sector():
    blind = (Coverage(0.4, 1.0),)
    radar = replace(RADAR, visibility=Visibility(max_range=15e3, blind=blind), clutter_rate=2e3)
    found, source = detect(standing(50), np.full(50, 1e4), radar, np.random.default_rng(0))
    assert (np.abs(found.measurement[:, 1] - 0.9) > 0.5).all()
    assert not source.any()
    assert len(found) == pytest.approx(2e3 * (1.0 - 1.0 / (2.0 * np.pi)), abs=4.5 * 41.0)


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


def plots(**document):
    given = {"scans": 601, "interval_s": 1.0, "targets": [OVERHEAD], "transponders": {}, **document}
    config = resolve(PARAMETERS, SystemPlane)
    run = scenario_file.resolve(given, config.model.radars)
    radar = TurningRadar(run, 0, config.inputs[0])
    found, answers = plots_with_replies(radar, 1)
    return run, radar.times_at(found.revolutions), found, answers


def test_target_in_a_gap_has_no_plots():
    run, time_s, _, _ = plots(gaps={"count": 1, "shortest_s": 60.0, "longest_s": 61.0, "seed": 2})
    (gap,) = run.gaps
    assert not ((time_s >= gap.start_s) & (time_s < gap.end_s)).any()
    missing = np.flatnonzero(np.diff(time_s) > 8.0)
    assert len(missing) == 1
    assert time_s[missing[0]] == pytest.approx(gap.start_s, abs=4.01)


def test_target_is_not_seen_above_and_below_the_beam():
    _, _, everything, _ = plots()
    _, _, found, _ = plots(antennas={"hill": {"lowest_deg": 6.0, "highest_deg": 45.0}})
    assert 0 < len(found.revolutions) < len(everything.revolutions)
    sine = ABOVE / found.measurement[:, 0]
    # The earth's curvature is 0.1 degrees at these ranges.
    assert 5.8 < np.degrees(np.arcsin(sine)).min() < 6.5
    assert 40.0 < np.degrees(np.arcsin(sine)).max() < 45.1


def test_mirrored_answer_is_seen_at_the_mirror_farther_by_the_detour():
    mirror = {**MIRROR, "start_deg": 170.0, "width_deg": 20.0}
    run, time_s, found, answers = plots(mirrors=[mirror], transponders={"reply_probability": 1.0})
    false = found.source == 0
    # The mirror shows it once a revolution while it is in the south.
    assert np.count_nonzero(false) == pytest.approx(75, abs=2)
    assert (found.replying == 1).all()
    assert (answers.address[false] == run.replies_of[1].address).all()
    assert (answers.code[false] == run.replies_of[1].code).all()
    np.testing.assert_allclose(found.measurement[false, 1], np.arctan2(4.0, 3.0), atol=1e-4)
    y = -60e3 + 200.0 * time_s[false]
    path = 5000.0 + np.hypot(y - 4000.0, 10.0 - 3000.0)
    slant = found.measurement[false, 0] - (path - np.hypot(10.0, y))
    np.testing.assert_allclose(slant, np.sqrt(y**2 + ABOVE**2), rtol=2e-3)


def test_mirror_reflects_no_target_in_other_directions_or_without_a_transponder():
    mirror = {**MIRROR, "start_deg": 45.0, "width_deg": 90.0}
    assert (plots(mirrors=[mirror])[2].source == 1).all()
    everywhere = {**mirror, "width_deg": 360.0}
    assert (plots(mirrors=[everywhere])[2].source == 0).any()
    _, _, found, answers = plots(mirrors=[everywhere], transponders={"share": 0.0})
    assert (found.source == 1).all()
    assert (answers.address == UNKNOWN).all()


def test_plots_before_scan_0_are_left_out():
    config = resolve({**PARAMETERS, "hill.clutter_rate": 50.0}, SystemPlane)
    antennas = {"hill": {"bearing_deg": 200.0}}
    given = {"scans": 61, "interval_s": 1.0, "antennas": antennas}
    run = scenario_file.resolve(given, config.model.radars)
    radar = TurningRadar(run, 0, config.inputs[0])
    found, answers = plots_with_replies(radar, 1)
    assert len(found.revolutions) == len(answers) > 500
    assert radar.times_at(found.revolutions).min() >= 0.0


def reports(**document):
    scene = scenario_file.resolve({**DOCUMENT, **document}, CONFIG.model.radars)
    return simulate_reports(scene, CONFIG.inputs, seed=1)


def test_a_radar_has_the_errors_that_a_scenario_gives_it_and_the_others_none():
    exact, wrong = reports(), reports(biases={"other": ERRORS})
    for radar in (0, 1):
        before = [report for report in exact if report.radar == radar]
        after = [report for report in wrong if report.radar == radar]
        assert len(before) == len(after) > 4
        for right, biased in zip(before, after, strict=True):
            # The antenna reports north before it is there.
            late_s = radar * (0.5 - 4.0 * 0.3 / 360.0)
            assert biased.stamp_ns - right.stamp_ns == pytest.approx(late_s * 1e9, abs=1.0)
            assert len(right.detections)
            distance = right.detections.measurement[:, 0]
            off = biased.detections.measurement - right.detections.measurement
            assert_allclose(off[:, 0], radar * (80.0 + 1e-3 * distance), atol=1e-6)
            # Clockwise is negative here.
            turned = np.mod(off[:, 1] + np.pi, 2 * np.pi) - np.pi
            assert_allclose(np.degrees(turned), -0.3 * radar, atol=1e-9)
            until_stamp = biased.detections.time_s - right.detections.time_s
            assert_allclose(until_stamp, radar * 0.5 - late_s, atol=1e-9)
    assert [r.stamp_ns for r in wrong] == sorted(r.stamp_ns for r in wrong)


def test_a_misaligned_antenna_cuts_its_sectors_at_its_reported_azimuth():
    layouts = [replace(layout, sectors=16) for layout in CONFIG.inputs]
    document = {**DOCUMENT, "biases": {"other": {"azimuth_bias_deg": 5.0}}}
    scene = scenario_file.resolve(document, CONFIG.model.radars)
    found = [report.detections for report in simulate_reports(scene, layouts, seed=1)]
    assert sum(map(len, found)) > 50
    for detections in found:
        assert sector_probability(detections.measurement[:, 1], detections.coverage).all()


def test_even_antenna_turns_at_its_rate_and_back():
    for antenna in (WINDY, Antenna(bearing=2.0), Antenna(wobble=0.5, wobble_period_s=30.0)):
        revolutions = antenna.revolutions_at(TIMES, ROTATION_S)
        assert (np.diff(revolutions) > 0.0).all()
        np.testing.assert_allclose(antenna.times_at(revolutions, ROTATION_S), TIMES, atol=0.005)
    revolutions = Antenna(bearing=np.pi / 2.0).revolutions_at(TIMES, ROTATION_S)
    np.testing.assert_array_equal(revolutions, TIMES / ROTATION_S + 0.25)


def test_wobble_is_a_share_of_the_rate_and_even_over_its_period():
    rate = np.diff(WINDY.revolutions_at(TIMES, ROTATION_S)) / np.diff(TIMES)
    np.testing.assert_allclose(
        [rate.max(), rate.min()], np.array([1.005, 0.995]) / ROTATION_S, rtol=1e-5
    )
    after = WINDY.revolutions_at(700.0 * np.arange(6), ROTATION_S)
    np.testing.assert_allclose(np.diff(after), 700.0 / ROTATION_S)
    half = WINDY.revolutions_at(np.array([175.0]), ROTATION_S)[0] - after[0]
    # A quarter of a sine is ahead by its integral.
    assert half - 175.0 / ROTATION_S == pytest.approx(0.005 * 700.0 / (2.0 * np.pi) / ROTATION_S)
