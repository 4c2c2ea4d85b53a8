"""Radars whose antennas turn."""

import math
from dataclasses import replace

import numpy as np
import pytest
from reference import resolve
from scenario_blocks import exact

from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.sensors.visibility import sector_probability
from phd_jdtc_ros.core.types import FULL_TURN
from phd_jdtc_ros.simulation.antenna import Antenna
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import Flight, Leg, TargetScript
from phd_jdtc_ros.simulation.turning_antenna import TurningRadar, plots_of, simulate_reports

ROTATION_S = 4.0
PARAMETERS = exact(
    "approach", 1e5, position=[0.0, 0.0], rotation_s=ROTATION_S, **{"fields.amplitude": ""}
)
NORTH = Antenna()
CROSSING_NORTH = Flight(0, 1e3, 0.0, (-3e3, 20e3), (150.0, 20.0), (Leg(60.0),))
BACK = Flight(0, 1e3, 5.0, (3e3, 20e3), (-150.0, 0.0), (Leg(20.0), Leg(30.0, 0.05)))
CIRCLING = Flight(0, 1e3, 0.0, (2e3, 0.0), (0.0, 200.0), (Leg(120.0, 0.1),))


def scene(*flights, antenna=NORTH, duration_s=60.0, **changes):
    """Return a scenario of one turning radar, and its inputs."""
    config = resolve({**PARAMETERS, **{f"approach.{k}": v for k, v in changes.items()}})
    scans = int(duration_s) + 1
    radars = config.model.radars
    found = Scenario(10**12, 1.0, scans, flights, radars, (antenna,) * len(radars))
    return found, config.inputs


def beam_deg(antenna, time_s, rotation_s=ROTATION_S):
    """Return where an antenna points, degrees counter-clockwise from the x axis."""
    turned = np.degrees(antenna.bearing) + 360.0 * time_s / rotation_s
    return 90.0 - turned if antenna.clockwise else 90.0 + turned


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("flight", [CROSSING_NORTH, BACK, CIRCLING])
@pytest.mark.parametrize("bearing", [0.0, 2.0])
def test_passes_are_when_the_beam_points_at_the_target(flight, clockwise, bearing):
    antenna = Antenna(bearing, clockwise)
    found, inputs = scene(flight, antenna=antenna, duration_s=200.0)
    (radar,) = found.radars
    time = TurningRadar(found, 0, inputs[0]).passes(flight)
    azimuth = radar.measure(flight.states(time))[:, 1]
    off = wrap_angle(np.radians(beam_deg(antenna, time)) - azimuth)
    np.testing.assert_allclose(off, 0.0, atol=1e-9)
    # None is left out: the beam is ahead of the target by one more revolution at each.
    fine = np.arange(flight.start_s, flight.end_s, 1e-3)
    sense = -1.0 if clockwise else 1.0
    target = np.unwrap(radar.measure(flight.states(fine))[:, 1])
    ahead = sense * (np.radians(beam_deg(antenna, fine)) - target) / FULL_TURN
    expected = fine[np.flatnonzero(np.diff(np.floor(ahead)))]
    np.testing.assert_allclose(time, expected, atol=2e-3)


def test_a_detection_is_where_the_target_is_at_its_own_time():
    found, inputs = scene(CROSSING_NORTH, BACK, CIRCLING)
    (radar,) = found.radars
    reports = simulate_reports(found, inputs, 3)
    seen = 0
    for report in reports:
        elapsed = (report.stamp_ns - found.start_ns) * 1e-9 + report.detections.time_s
        for time, measured, source in zip(
            elapsed, report.detections.measurement, report.source, strict=True
        ):
            state = found.flights[source - 1].states(np.array([time]))
            apart = radar.to_world(measured[None])[0] - state[0, [0, 2]]
            assert np.hypot(*apart) < 0.01
            seen += 1
    assert seen == pytest.approx(3 * 14, abs=3)


def test_revolutions_and_sectors_without_plots_are_reported_at_their_end():
    found, inputs = scene(CROSSING_NORTH, antenna=Antenna(math.pi / 2.0), duration_s=20.0)
    reports = simulate_reports(found, inputs, 0)
    # A quarter of a revolution was over at scan 0, and that revolution is left out.
    assert [(r.stamp_ns - found.start_ns) / 1e9 for r in reports] == [7.0, 11.0, 15.0, 19.0]
    for report in reports:
        assert report.detections.coverage is None
        assert ((report.detections.time_s <= 0.0) & (report.detections.time_s > -4.0)).all()
    found, inputs = scene(CROSSING_NORTH, sectors=32, duration_s=8.0)
    reports = simulate_reports(found, inputs, 0)
    assert len(reports) == 64
    assert sum(len(report.detections) == 0 for report in reports) >= 60


@pytest.mark.parametrize("clockwise", [True, False])
def test_sectors_cover_the_revolution_in_the_order_in_which_the_antenna_turns(clockwise):
    antenna = Antenna(0.0, clockwise)
    found, inputs = scene(
        CIRCLING, antenna=antenna, sectors=16, clutter_rate=300.0, clutter_max_range=9e4
    )
    reports = simulate_reports(found, inputs, 0)
    stamps = [(r.stamp_ns - found.start_ns) * 1e-9 for r in reports]
    np.testing.assert_allclose(stamps, 0.25 * np.arange(1, 16 * 15 + 1))
    for number, report in enumerate(reports):
        coverage = report.detections.coverage
        assert coverage.width == pytest.approx(FULL_TURN / 16)
        # Its middle is where the antenna points in the middle of its time.
        middle = np.radians(beam_deg(antenna, 0.25 * number + 0.125))
        assert wrap_angle(coverage.start + 0.5 * coverage.width - middle) == pytest.approx(0.0)
        assert sector_probability(report.detections.measurement[:, 1], coverage).all()
        time = report.detections.time_s
        assert ((time <= 1e-9) & (time >= -0.25 - 1e-9)).all()
    assert sum(len(r.detections) for r in reports) == pytest.approx(300 * 15, rel=0.1)


def test_plots_do_not_depend_on_how_they_are_reported():
    changes = {"clutter_rate": 20.0, "range_std": 50.0, "azimuth_std_deg": 0.1}
    plots = []
    for sectors in (0, 16):
        found, inputs = scene(CROSSING_NORTH, CIRCLING, sectors=sectors, **changes)
        reports = simulate_reports(found, inputs, 7)
        time = [(r.stamp_ns - found.start_ns) * 1e-9 + r.detections.time_s for r in reports]
        measured = np.concatenate([r.detections.measurement for r in reports])
        plots.append(np.column_stack([np.concatenate(time), measured]))
    np.testing.assert_allclose(plots[0], plots[1], atol=1e-8)


def test_detections_of_a_seed_have_what_the_messages_have():
    found, inputs = scene(CROSSING_NORTH, **{"fields.time": "", "fields.amplitude": "amplitude"})
    for report in simulate_reports(found, inputs, 0):
        assert report.detections.time_s is None
        assert (report.detections.amplitude > found.radars[0].threshold).all()
    found, inputs = scene(CROSSING_NORTH)
    assert all(r.detections.amplitude is None for r in simulate_reports(found, inputs, 0))
    found, inputs = scene(CIRCLING, clutter_rate=30.0)
    first, second, other = (simulate_reports(found, inputs, seed) for seed in (5, 5, 6))
    for a, b in zip(first, second, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.detections.measurement, b.detections.measurement)
    assert len(first[0].detections) != len(other[0].detections)


def test_targets_are_detected_with_the_given_probability_over_range():
    ring = [
        Flight(0, 1.0, 0.0, (d * math.cos(a), d * math.sin(a)), (0.0, 0.0), (Leg(60.0),))
        for d in (20e3, 60e3)
        for a in np.linspace(0.01, 6.2, 100)
    ]
    found, inputs = scene(
        *ring,
        detection_probability=[0.9, 0.9, 0.1],
        detection_probability_range=[0.0, 40e3, 80e3],
    )
    plots = plots_of(TurningRadar(found, 0, inputs[0]), np.random.default_rng(1))
    near = plots.measurement[:, 0] < 40e3
    # 15 revolutions of 100 targets each.
    assert near.sum() / 1500 == pytest.approx(0.9, abs=0.03)
    assert (~near).sum() / 1500 == pytest.approx(0.5, abs=0.05)


def test_nothing_is_seen_in_blind_sectors_and_below_the_least_range():
    found, inputs = scene(
        CIRCLING, CROSSING_NORTH, clutter_rate=500.0, min_range=2e3, blind_sectors_deg=[80.0, 120.0]
    )
    plots = plots_of(TurningRadar(found, 0, inputs[0]), np.random.default_rng(1))
    degrees = np.degrees(plots.measurement[:, 1])
    assert not ((degrees > 80.1) & (degrees < 119.9)).any()
    assert plots.measurement[:, 0].min() > 1999.0
    assert (plots.source == 0).sum() == pytest.approx(7500 * (320 / 360) * 0.98, rel=0.05)


def test_noise_has_the_deviations_of_the_radar():
    still = Flight(0, 1.0, 0.0, (30e3, 10e3), (0.0, 0.0), (Leg(8000.0),))
    found, inputs = scene(still, duration_s=8000.0, range_std=30.0, azimuth_std_deg=0.2)
    measured = plots_of(TurningRadar(found, 0, inputs[0]), np.random.default_rng(1)).measurement
    exact = found.radars[0].measure(still.states(np.zeros(1)))[0]
    std = (measured - exact).std(axis=0)
    assert std[0] == pytest.approx(30.0, rel=0.05)
    assert np.degrees(std[1]) == pytest.approx(0.2, rel=0.05)


def test_only_the_nearest_radars_see_a_target_where_their_number_is_limited():
    config = resolve(
        {
            "sensors": ["a", "b", "c"],
            **{f"{name}.rotation_s": 4.0 for name in "abc"},
            **{f"{name}.max_range": 5e4 for name in "abc"},
            **{f"{name}.detection_probability": 0.999 for name in "abc"},
            **{f"{name}.clutter_rate": 0.0 for name in "abc"},
            "a.position": [0.0, 0.0],
            "b.position": [1e4, 0.0],
            "c.position": [2e5, 0.0],
        }
    )
    passing = Flight(0, 1e3, 0.0, (-5e3, 5e3), (100.0, 0.0), (Leg(200.0),))
    found = Scenario(10**12, 1.0, 201, (passing,), config.model.radars, most_radars=1)
    seen = {0: [], 1: []}
    for report in simulate_reports(found, config.inputs, 0):
        assert report.radar != 2 or len(report.detections) == 0
        if len(report.detections):
            seen[report.radar].append((report.stamp_ns - found.start_ns) * 1e-9)
    # It is nearer to the second from 100 s on; stamps are up to a revolution later.
    assert len(seen[0]) > 20
    assert max(seen[0]) < 105.0
    assert len(seen[1]) > 20
    assert min(seen[1]) > 99.0
    everyone = simulate_reports(replace(found, most_radars=0), config.inputs, 0)
    assert max(r.stamp_ns for r in everyone if r.radar == 0 and len(r.detections)) > 10**12 + 190e9


def test_radars_that_do_not_turn_report_every_scan_beside_one_that_does():
    config = resolve({"radar_1.rotation_s": 2.5, "radar_1.fields.time": "time"})
    target = TargetScript(0, 1e4, (5e3, 5e3), (10.0, 0.0), 0, 10)
    found = Scenario(10**12, 6.0, 11, (target,), config.model.radars)
    reports = simulate_reports(found, config.inputs, 0)
    still = [(r.stamp_ns - found.start_ns) / 1e9 for r in reports if r.radar == 1]
    assert still == [6.0 * scan for scan in range(11)]
    assert sum(report.radar == 0 for report in reports) == 24
    assert [r.stamp_ns for r in reports] == sorted(r.stamp_ns for r in reports)
    assert found.turning
    assert not replace(found, radars=found.radars[1:], antennas=()).turning


def test_usual_antennas_of_equal_revolutions_do_not_point_the_same_way():
    found, _ = scene()
    antennas = replace(found, radars=found.radars * 8, antennas=()).antennas
    bearings = np.sort([antenna.bearing for antenna in antennas])
    assert bearings[0] == 0.0
    assert np.diff(bearings, append=FULL_TURN).min() > 0.2
