"""Estimates of a sensor of positions from a recording: noise, velocities, area and rates."""

import numpy as np
import pytest
import street
from numpy.testing import assert_allclose

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.area import area_of, covers
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import plots_of
from phd_jdtc_ros.core.sensors.position import Area
from phd_jdtc_ros.core.types import Detections, Pose

SPEED_STD, SCANS = 0.8, 200


def reports(seed, yaw=0.0, position=(0.0, 0.0)):
    """Return reports with velocities from a sensor at a pose."""
    rng, place = np.random.default_rng([seed, 3]), street.truth(seed)
    speed = np.gradient(place, street.INTERVAL_S, axis=0)
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn, found = np.array([[cos, -sin], [sin, cos]]), []
    for number in range(SCANS):
        seen = rng.random(place.shape[1]) < street.DETECTED
        measured = place[number, seen] + street.STD * rng.standard_normal((seen.sum(), 2))
        velocity = speed[number, seen] + SPEED_STD * rng.standard_normal((seen.sum(), 2))
        false = rng.uniform(-street.EXTENT, street.EXTENT, (rng.poisson(street.FALSE), 2))
        at = (np.concatenate([measured, false]) - position) @ turn
        velocities = np.concatenate([velocity, np.full(false.shape, np.nan)]) @ turn
        pose = Pose(position, yaw) if yaw else None
        own = Detections(at, None, velocity=velocities, pose=pose)
        found.append((round(1e9 * street.TIMES[number]), own))
    return found


@pytest.mark.parametrize(("yaw", "position"), [(0.0, (0.0, 0.0)), (0.7, (30.0, -5.0))])
def test_noise_velocities_and_rates_are_found(yaw, position):
    found = findings(plots_of(reports(5, yaw, position), places=True))
    assert_allclose([found.noise.range_std, found.noise.azimuth_std], street.STD, rtol=0.12)
    assert found.velocity.noise.value == pytest.approx(SPEED_STD, rel=0.06)
    assert found.detection.value == pytest.approx(street.DETECTED, abs=0.02)
    assert found.clutter.value == pytest.approx(street.FALSE, rel=0.2)
    assert found.timing.rotation_s == 0.0
    # Who stands is no land clutter.
    assert (found.resting, found.slow_speed, found.crowded) == (0.0, 0.0, 0.0)


def test_copies_with_another_rounding_under_a_later_stamp_do_not_show_the_noise():
    rng, doubled = np.random.default_rng(4), []
    for stamp_ns, found in reports(5):
        near = found.measurement + 1e-3 * rng.standard_normal(found.measurement.shape)
        copy = Detections(near, None, velocity=found.velocity)
        doubled += [(stamp_ns, found), (stamp_ns + 5_000_000, copy)]
    noise = findings(plots_of(doubled, places=True)).noise
    assert_allclose([noise.range_std, noise.azimuth_std], street.STD, rtol=0.15)


def test_proposal_has_the_parameters_of_positions():
    found = findings(plots_of(reports(6), places=True))
    rows = {row.name: row for row in proposal.rows(found, {}, "lidar")}
    proposed = {name for name, row in rows.items() if row.proposed}
    assert proposed == {
        *("position_std", "velocity_std", "detection_probability", "area", "clutter_rate"),
    }
    assert rows["velocity_std"].value == pytest.approx(SPEED_STD, rel=0.06)
    # A configured area that contains all places, and is not much larger, is kept.
    for area, is_kept in (
        ([-50.0, -30.0, 50.0, 30.0], True),
        ([-20.0, -30.0, 50.0, 30.0], False),
        ([-500.0, -300.0, 500.0, 300.0], False),
    ):
        rows = {r.name: r for r in proposal.rows(found, {"lidar.area": area}, "lidar")}
        assert rows["area"].proposed != is_kept


def test_area_leaves_out_what_is_far_from_all_others():
    rng = np.random.default_rng(2)
    place = rng.uniform([500e3, 5.4e6], [500.1e3, 5.40005e6], (300, 2))
    far = np.concatenate([place, [[0.0, 0.0], [1e9, -1e9]]])
    assert area_of(far) == area_of(place)
    x_min, y_min, x_max, y_max = area_of(place)
    assert (x_min < place[:, 0].min(), x_max > place[:, 0].max()) == (True, True)
    assert (y_max - y_min) < 1.3 * np.ptp(place[:, 1])


def circle(distance, bearing):
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])


@pytest.mark.parametrize("half_deg", [180.0, 40.0])
def test_area_of_a_circle_or_a_sector_has_hardly_a_place_that_is_not_seen(half_deg):
    rng, half = np.random.default_rng(8), np.radians(half_deg)
    place = circle(60.0 * np.sqrt(rng.random(4000)), 1.0 + rng.uniform(-half, half, 4000))
    found = area_of(place)
    assert 6 < len(found) <= 32
    polygon = Area.of(found)
    assert polygon.probability(place).all()
    assert polygon.size == pytest.approx(half * 60.0**2, rel=0.03)
    # A rectangle has half as much again, or more.
    around = circle(62.5, np.linspace(-np.pi, np.pi, 100))
    assert not polygon.probability(around).any()


@pytest.mark.parametrize("seed", range(3))
def test_area_of_few_places_or_of_a_rectangle_is_a_rectangle(seed):
    rng = np.random.default_rng([seed, 9])
    few = circle(60.0 * np.sqrt(rng.random(40)), rng.uniform(-np.pi, np.pi, 40))
    still = rng.uniform(-20.0, 20.0, (3, 1, 2)) + 0.1 * rng.standard_normal((3, 200, 2))
    street = np.linspace(0.0, 100.0, 500)[:, None] + rng.uniform(-1.0, 1.0, (500, 2))
    for place in (few, still.reshape(-1, 2), street):
        assert len(area_of(place)) == 4
    x_min, y_min, x_max, y_max = area_of(rng.uniform(-60.0, 60.0, (4000, 2)))
    assert_allclose([-x_min, -y_min, x_max, y_max], 60.0, atol=1.0)


def test_a_configured_polygon_is_kept_like_a_rectangle():
    rng = np.random.default_rng(10)
    place = circle(60.0 * np.sqrt(rng.random(4000)), rng.uniform(-np.pi, np.pi, 4000))
    found = area_of(place)
    octagon = circle(70.0, np.linspace(-np.pi, np.pi, 9)[:-1])
    for given, is_kept in ((octagon, True), (0.5 * octagon, False), (3.0 * octagon, False)):
        assert covers(given.ravel().tolist(), found, 1.5) == is_kept
    assert covers([-65.0, -65.0, 65.0, 65.0], found, 1.5)
    assert not covers(None, found, 1.5)


def test_recording_without_targets_names_the_extent_of_its_places():
    rng = np.random.default_rng(7)
    false = [(k * 10**8, Detections(rng.uniform(-5e3, 5e3, (9, 2)), None)) for k in range(60)]
    with pytest.raises(TuningError, match=r"clutter.*; x is from -4\d+.* m and y from -\d+.* m$"):
        findings(plots_of(false, places=True))


def test_first_state_of_a_place_is_its_position_with_its_noise():
    pose, measured = np.array([2.0, 3.0, 0.5]), np.array([4.0, 1.0])
    cos, sin = np.cos(0.5), np.sin(0.5)
    turn = np.array([[cos, -sin], [sin, cos]])
    mean, covariance = kinematics.initial_state(measured, pose, np.array([1.0, 9.0]), 2.0, True)
    assert_allclose(mean, [*(pose[:2] + turn @ measured), 0.0, 0.0])
    assert_allclose(covariance[:2, :2], turn @ np.diag([1.0, 9.0]) @ turn.T)
    assert_allclose(covariance[2:, 2:], 4.0 * np.eye(2))
