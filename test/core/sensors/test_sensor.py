"""A sensor that measures positions: it needs the abstract members only."""

from dataclasses import replace

import numpy as np
from position_sensor import PositionSensor

from phd_jdtc_ros.core.learned.detection_factor import CELLS, DetectionFactor, TrialSums
from phd_jdtc_ros.core.types import UNKNOWN_COVERAGE, Detections, Pose

STATE = np.array([[100.0, 3.0, 200.0, -4.0, 0.0], [0.0, 0.0, 50.0, 1.0, 0.0]])


SENSOR = PositionSensor(
    name="mast", position=(10.0, 20.0), yaw=0.0, threshold=3.0, clutter_rate=2.0
)
DETECTIONS = Detections(
    np.array([[90.0, 180.0], [0.0, 0.0]]), None, noise_std=np.array([[1.0, 2.0], [np.nan, np.nan]])
)


def test_measurements_and_noise_follow_from_the_linearised_measurement():
    np.testing.assert_array_equal(SENSOR.measure(STATE), [[90.0, 180.0], [-10.0, 30.0]])
    np.testing.assert_array_equal(SENSOR.measurement_rate(STATE), [[3.0, -4.0], [0.0, 1.0]])
    np.testing.assert_array_equal(SENSOR.noise_std_of(DETECTIONS), [[1.0, 2.0], [5.0, 5.0]])
    correlated = replace(DETECTIONS, noise_correlation=np.array([0.5, np.nan]))
    covariance = SENSOR.noise_covariance_of(correlated)
    np.testing.assert_array_equal(covariance, [[[1.0, 1.0], [1.0, 4.0]], 25.0 * np.eye(2)])


def test_sensor_without_coverage_or_map_sees_everything_in_uniform_clutter():
    measured = SENSOR.measure(STATE)
    assert SENSOR.coverage_probability(measured, UNKNOWN_COVERAGE).tolist() == [1.0, 1.0]
    assert SENSOR.may_have_swept(STATE[:, :2], np.ones(2), DETECTIONS).all()
    assert SENSOR.configured_detection_probability(measured) is None
    np.testing.assert_allclose(SENSOR.log_clutter_intensity(DETECTIONS), np.log(2e-6))
    assert not SENSOR.neighbourhood_density(DETECTIONS.measurement, STATE[:, :2]).any()


def test_detection_probability_is_learned_by_range_and_azimuth_from_the_sensor():
    trials = TrialSums(np.full(CELLS, 99.0), np.full(CELLS, 90.0), np.arange(float(CELLS)))
    factor = DetectionFactor(1000.0).after(trials)
    sensor = replace(SENSOR, yaw=0.5, detection_factor=factor)
    place = np.array([[200.0, 0.3], [900.0, 2.0]])
    azimuth = place[:, 1] + sensor.yaw
    measured = place[:, :1] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    np.testing.assert_allclose(sensor.polar_place(measured), place)
    found = sensor.learned_detection_probability(np.full(2, 0.9), measured)
    np.testing.assert_array_equal(found, factor.probability(np.full(2, 0.9), place))


def test_pose_moves_the_sensor_and_keeps_the_rest():
    moved = SENSOR.at(Pose((1.0, 2.0), 0.5, (3.0, 4.0)))
    assert (moved.position, moved.yaw, moved.velocity) == ((1.0, 2.0), 0.5, (3.0, 4.0))
    assert (moved.std, moved.name, moved.polar) == (5.0, "mast", False)
