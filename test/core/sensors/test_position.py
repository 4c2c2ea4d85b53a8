"""A sensor of positions: its measurements, its noise, and its area."""

from dataclasses import replace

import numpy as np
import pytest
from mast import mast
from numpy.testing import assert_allclose, assert_array_equal

from phd_jdtc_ros.core.factors.recent_looks import RecentLooks
from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.poses import Mount, PoseTrack
from phd_jdtc_ros.core.models.detection_clusters import merge_clusters
from phd_jdtc_ros.core.sensors.position import Area, WatchedArea
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Coverage, Detections, Pose

YAW = np.radians(30.0)
FIELD = WatchedArea(Area.rectangle(-50.0, -20.0, 50.0, 80.0), 0.9)
SENSOR = mast(2.0, position=(20.0, -10.0), yaw=YAW, visibility=FIELD)
# Ahead of the sensor by 10 m and to its left by 4 m.
AHEAD, LEFT = np.array([np.cos(YAW), np.sin(YAW)]), np.array([-np.sin(YAW), np.cos(YAW)])
PLACE = np.array([[20.0, -10.0]]) + 10.0 * AHEAD + 4.0 * LEFT


def test_measurements_are_places_in_the_sensors_frame():
    measured, jacobian = SENSOR.linearise(PLACE)
    assert_allclose(measured, [[10.0, 4.0]], atol=1e-12)
    assert_allclose(SENSOR.to_world(measured), PLACE, atol=1e-12)
    assert_allclose(jacobian[0], [AHEAD, LEFT])
    assert_array_equal(SENSOR.log_jacobian(measured), [0.0])
    state = np.array([[PLACE[0, 0], 3.0, PLACE[0, 1], 4.0, 0.0]])
    assert_allclose(SENSOR.measure(state), measured)


def test_noise_is_the_detections_own_in_the_world_frame():
    std, correlation = np.array([[1.0, 3.0], [np.nan, np.nan]]), np.array([0.5, np.nan])
    found = Detections(np.zeros((2, 2)), None, noise_std=std, noise_correlation=correlation)
    turn = np.stack([AHEAD, LEFT], axis=1)
    own = turn @ [[1.0, 1.5], [1.5, 9.0]] @ turn.T
    assert_allclose(SENSOR.in_plane(found).covariance, [own, 4.0 * np.eye(2)], atol=1e-12)
    scaled = SENSOR.with_scaled_noise(np.array([2.0, 3.0, 1.0]))
    assert_array_equal(scaled.noise_std, [4.0, 6.0])


def test_targets_are_detected_in_the_area():
    measured = np.array([[0.0, 0.0], [50.0, 0.0], [80.0, 0.0]])
    assert_array_equal(SENSOR.visibility.probability_in_view(measured), [1.0, 1.0, 0.0])
    std = np.full((3, 2), 1.0)
    found = SENSOR.visibility.probability_in_view(measured, std)
    assert_allclose(found, [1.0, 0.5, 0.0], atol=1e-12)
    # A sensor that does not turn has no sectors.
    assert_array_equal(
        SENSOR.visibility.coverage_probability(measured, Coverage(0.0, 1.0), SENSOR.noise_std, std),
        found,
    )
    component, interval = FIELD.limits
    assert_array_equal(component, [0, 1])
    assert_array_equal(interval, [[-50.0, 50.0], [-20.0, 80.0]])
    assert FIELD.may_be_swept(PLACE, np.ones(1), SENSOR.noise_std, Detections(measured, None)).all()
    assert_array_equal(FIELD.detection_probability(measured), [0.9] * 3)
    triangle = WatchedArea(Area(np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]])), 0.9)
    assert len(triangle.limits[0]) == 0
    assert triangle.size == pytest.approx(40.5)


def test_a_report_has_the_area_that_it_covered():
    found = Detections(np.zeros((1, 2)), None, area=(0.0, 0.0, 10.0, 60.0))
    view = View.of(SENSOR, found)
    seen = view.sensor.visibility
    measured = np.array([[5.0, 50.0], [-5.0, 0.0], [10.0, 30.0]])
    assert_array_equal(seen.probability_in_view(measured[:2]), [1.0, 0.0])
    assert_allclose(seen.probability_in_view(measured[2:], np.ones((1, 2))), 0.5)
    assert_array_equal(seen.limits[1], [[0.0, 10.0], [0.0, 60.0]])
    # Densities are those of the sensor's area, so that fewer false detections are expected.
    assert view.log_clutter == View.of(SENSOR, Detections(np.zeros((1, 2)), None)).log_clutter
    assert seen.clutter_share == pytest.approx(600.0 / 1e4)
    assert FIELD.of(Detections(measured, None)) is FIELD
    looks = (
        RecentLooks.of_none().after(view, 0).after(View.of(SENSOR, Detections(measured, None)), 0)
    )
    assert_array_equal(looks.view(0, SENSOR).sensor.visibility.limits[1], seen.limits[1])
    assert_array_equal(looks.view(1, SENSOR).sensor.visibility.limits[1], FIELD.limits[1])


def test_false_detections_are_uniform_in_the_area_and_in_a_span_of_velocities():
    found = Detections(np.zeros((2, 2)), None, velocity=np.array([[3.0, 4.0], [np.nan, 0.0]]))
    assert_allclose(View.of(SENSOR, found).log_clutter, np.log(4.0 / 1e4))
    moving = replace(SENSOR, velocity_model=VelocityModel(0.5, span=50.0))
    expected = np.log(4.0 / 1e4) - np.log([2500.0, 1.0])
    assert_allclose(View.of(moving, found).log_clutter, expected)
    # False climb rates have a span of their own, and an unknown one that of the others.
    climb, own_std = np.array([[0.2], [0.0]]), np.array([[0.5] * 3, [0.5, 0.5, 80.0]])
    rising = found.changed(
        velocity=np.hstack([[[3.0, 4.0], [1.0, 0.0]], climb]), velocity_std=own_std
    )
    expected = np.log(4.0 / 1e4) - np.log([2500.0 * 20.0, 2500.0 * 50.0])
    assert_allclose(View.of(moving, rising).log_clutter, expected)


def test_velocities_are_turned_into_the_world_frame():
    moving = replace(SENSOR, velocity_model=VelocityModel(0.5))
    velocity = np.array([[3.0, 4.0], [np.nan, 0.0]])
    std = np.array([[1.0, 2.0], [np.nan, np.nan]])
    found = Detections(np.zeros((2, 2)), None, velocity=velocity, velocity_std=std)
    view = View.of(moving, found)
    assert_allclose(view.velocities.velocity[0], 3.0 * AHEAD + 4.0 * LEFT)
    turn = np.stack([AHEAD, LEFT], axis=1)
    assert_allclose(view.velocities.noise[0], turn @ np.diag([1.0, 4.0]) @ turn.T, atol=1e-12)
    assert_allclose(view.velocities.noise[1], 0.25 * np.eye(2), atol=1e-12)
    assert view.velocities.is_known.tolist() == [True, False]
    assert View.of(SENSOR, found).velocities is None
    assert View.of(moving, Detections(np.zeros((1, 2)), None)).velocities is None


def test_detections_near_each_other_are_merged_unless_their_velocities_differ():
    place = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [30.0, 0.0]])
    velocity = np.array([[2.0, 0.0], [2.2, 0.0], [-9.0, 0.0], [np.nan, np.nan]])
    moving = mast(0.1, cluster_distance=2.0, yaw=YAW, velocity_model=VelocityModel(0.5))
    found = merge_clusters(Detections(place, None, velocity=velocity), moving)
    assert_allclose(found.measurement, [[0.5, 0.0], [0.5, 0.5], [30.0, 0.0]])
    assert_allclose(found.velocity, [[2.1, 0.0], [-9.0, 0.0], [np.nan, np.nan]])
    alone = mast(0.1, cluster_distance=2.0, yaw=YAW)
    found = merge_clusters(Detections(place, None), alone)
    assert_allclose(found.measurement, [[0.5, 0.5 / 3.0], [30.0, 0.0]])


def test_positions_of_a_platform_that_moves_are_those_at_the_stamp():
    track = PoseTrack(True, 1.0, 100.0, 10.0)
    # It moves east at 10 m/s and turns left by 0.2 rad/s.
    for seconds in np.arange(0.0, 3.0, 0.1):
        track.add(round(1e9 * (1000.0 + seconds)), Pose((10.0 * seconds, 5.0), 0.2 * seconds))
    platform = Platform(track, Mount((1.0, 2.0), 0.5), positions=True)
    targets, time_s = np.array([[40.0, 9.0], [-20.0, 3.0]]), np.array([-0.4, 0.2])
    over_ground = np.array([[3.0, -1.0], [0.5, 2.0]])

    def in_frame(vectors, seconds):
        yaw = 0.2 * seconds + 0.5
        cos, sin = np.cos(yaw), np.sin(yaw)
        return vectors @ np.array([[cos, -sin], [sin, cos]])

    def sensor_at(seconds):
        cos, sin = np.cos(0.2 * seconds), np.sin(0.2 * seconds)
        offset = np.array([cos - 2.0 * sin, sin + 2.0 * cos])
        return np.array([10.0 * seconds, 5.0]) + offset

    times = 1.5 + time_s
    measured = [in_frame(p - sensor_at(t), t) for p, t in zip(targets, times, strict=True)]
    velocity = [in_frame(v, t) for v, t in zip(over_ground, times, strict=True)]
    sent = Detections(np.array(measured), None, time_s, velocity=np.array(velocity))
    found, _ = platform.with_pose(round(1001.5e9), sent)
    assert_allclose(found.measurement, in_frame(targets - sensor_at(1.5), 1.5), atol=1e-6)
    assert_allclose(found.velocity, in_frame(over_ground, 1.5), atol=1e-9)
    moved = mast(velocity_model=VelocityModel(0.5)).at(found.pose)
    assert_allclose(moved.to_world(found.measurement), targets, atol=1e-6)
    assert_allclose(moved.motion_of(found).velocity, over_ground, atol=1e-9)
