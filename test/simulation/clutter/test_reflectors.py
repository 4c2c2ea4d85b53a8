"""What answers and is no target, and radars that a ship carries."""

import math

import numpy as np
import pytest
from reference import resolve
from scenario_blocks import QUAY, SHIP, exact

from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.factors.clutter.amplitude import level_db
from phd_jdtc_ros.core.intake.poses import Mount
from phd_jdtc_ros.core.types import FULL_TURN, Pose
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.turning_antenna import TurningRadar, plots_of, simulate_reports

RADAR = exact("mast", 2e4, position=[5.0, 2.0], yaw_deg=-90.0)
SHIP = {**SHIP, "radars": ["mast"]}
DOCUMENT = {"interval_s": 1.0, "scans": 41, "targets": [], "reflectors": [QUAY]}


def scene(rotation_s=0.0, radar=None, **changes):
    """Return a scenario, and its radar's input."""
    config = resolve({**RADAR, "mast.rotation_s": rotation_s, **(radar or {})})
    return scenario_file.resolve({**DOCUMENT, **changes}, config.model.radars), config.inputs


def off_the_quay(place):
    """Return how far each place is from the nearest reflector, metres."""
    found, _ = scene()
    points = np.array(found.reflectors[0].points)
    return np.hypot(*(place[:, None] - points).transpose(2, 0, 1)).min(axis=1)


def test_reflectors_stand_on_the_line_through_the_points():
    found, _ = scene()
    (kind,) = found.reflectors
    points = np.array(kind.points)
    assert len(points) == 21
    np.testing.assert_allclose(np.hypot(*np.diff(points, axis=0).T), 100.0)
    assert kind.points[10] == (1000.0, 4000.0)
    alone = scene(reflectors=[{**QUAY, "spacing": 0.0}])[0].reflectors[0].points
    assert alone == ((1000.0, 3000.0), (1000.0, 4000.0), (2000.0, 4000.0))


@pytest.mark.parametrize("platform", [{}, SHIP], ids=["ashore", "aboard"])
def test_reflectors_stay_in_the_world_in_every_scan(platform):
    found, _ = scene(platform=platform)
    seen = []
    for index, (truth, scan) in enumerate(simulate(found, 1)):
        assert len(truth.track_id) == 0
        radar = found.radar_at(0, float(index))
        seen.append(scan.detections[0].measurement)
        assert len(seen[-1]) == 21
        assert off_the_quay(radar.to_world(seen[-1])).max() < 0.01
    moved = np.abs(np.sort(seen[0], axis=0) - np.sort(seen[-1], axis=0)).max()
    assert (moved > 100.0) == bool(platform)


@pytest.mark.parametrize("platform", [{}, SHIP], ids=["ashore", "aboard"])
def test_plots_of_reflectors_are_measured_when_the_antenna_points_at_them(platform):
    found, (layout,) = scene(2.5, platform=platform)
    plots = plots_of(TurningRadar(found, 0, layout), np.random.default_rng(2))
    assert not plots.source.any()
    # Each is passed once a revolution, and once more or less where the ship turns by a part of one.
    assert 15 * 21 <= len(plots.revolutions) <= 17 * 21
    antenna, time_s = found.antennas[0], plots.revolutions * 2.5
    azimuth = np.pi / 2.0 - FULL_TURN * plots.revolutions
    off = wrap_angle(plots.measurement[:, 1] - azimuth)
    assert antenna.bearing == 0.0
    assert np.abs(off).max() < 1e-6
    world = [
        found.radar_at(0, float(when)).to_world(row[None])[0]
        for when, row in zip(time_s, plots.measurement, strict=True)
    ]
    assert off_the_quay(np.array(world)).max() < 0.01


def test_a_turning_ship_sees_targets_from_where_it_is():
    target = {"class_id": 0, "position": [3000.0, 0.0], "velocity": [0.0, 0.0]}
    target["legs"] = [{"duration_s": 40.0}]
    found, inputs = scene(2.5, platform=SHIP, targets=[target], reflectors=[])
    reports = simulate_reports(found, inputs, 3)
    assert sum(len(report.detections) for report in reports) >= 15
    for report in reports:
        stamp_s = (report.stamp_ns - found.start_ns) * 1e-9
        for row, time_s in zip(
            report.detections.measurement, report.detections.time_s, strict=True
        ):
            world = found.radar_at(0, stamp_s + float(time_s)).to_world(row[None])[0]
            np.testing.assert_allclose(world, [3000.0, 0.0], atol=0.01)
        assert report.source.tolist() == [1] * len(report.source)


def test_detection_probability_and_amplitudes_are_those_of_the_reflectors():
    quay = {**QUAY, "detection_probability": 0.4}
    found, _ = scene(reflectors=[quay], scans=201)
    runs = [scan.detections[0] for _, scan in simulate(found, 4)]
    count = sum(map(len, runs))
    expected = 201 * 21 * 0.4
    assert abs(count - expected) < 4.0 * math.sqrt(expected * 0.6)
    level = level_db(np.concatenate([run.amplitude for run in runs]))
    assert np.median(level) == pytest.approx(18.0, abs=0.4)
    assert np.std(level) == pytest.approx(3.0, abs=0.3)


def test_what_a_radar_cannot_see_does_not_answer():
    found, _ = scene(radar={"mast.max_range": 3500.0, "mast.clutter_max_range": 3500.0})
    for _, scan in simulate(found, 5)[:3]:
        radar = found.radars[0]
        place = radar.to_world(scan.detections[0].measurement)
        assert 0 < len(place) < 21
        assert np.hypot(*(place - radar.position).T).max() <= 3500.1


def test_poses_are_those_that_the_radar_is_mounted_on():
    found, _ = scene(platform={**SHIP, "pose_interval_s": 0.3})
    poses = found.poses()
    stamps = np.array([stamp_ns for stamp_ns, _ in poses])
    assert stamps[0] == found.start_ns
    assert found.ns_after(40.0) <= stamps[-1] < found.ns_after(40.3)
    np.testing.assert_allclose(np.diff(stamps), 0.3e9, atol=1)
    mount = Mount((5.0, 2.0), math.radians(-90.0))
    for stamp_ns, pose in poses[::7]:
        radar = found.radar_at(0, (stamp_ns - found.start_ns) * 1e-9)
        expected = mount.on(pose)
        np.testing.assert_allclose(radar.position, expected.position, atol=1e-6)
        np.testing.assert_allclose(np.exp(1j * (radar.yaw - expected.yaw)), 1.0, atol=1e-9)
    first = poses[0][1]
    assert first == Pose((-500.0, 100.0), math.atan2(8.0, 6.0))
    turned = math.remainder(found.platform.pose(40.0).yaw - first.yaw, FULL_TURN)
    assert math.degrees(turned) == pytest.approx(60.0)


def test_a_ship_that_stops_keeps_its_heading():
    legs = [{"duration_s": 10.0, "acceleration": -1.0}, {"duration_s": 10.0}]
    found, _ = scene(platform={**SHIP, "legs": legs})
    assert found.platform.pose(15.0).yaw == pytest.approx(math.atan2(8.0, 6.0))
