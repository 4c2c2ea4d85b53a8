"""What all sensors have in common: noise, reports and biases."""

from dataclasses import replace

import numpy as np
import pytest
from mast import mast
from numpy.testing import assert_allclose
from scenes import small

from phd_jdtc_ros.core.factors.detection import CELLS, Detection, TrialSums
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.gaussians import noise_covariance
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections, Pose

STATE = np.array([[100.0, 3.0, 200.0, -4.0, 0.0], [0.0, 0.0, 50.0, 1.0, 0.0]])
SENSOR = mast(position=(10.0, 20.0))
DETECTIONS = Detections(
    np.array([[90.0, 180.0], [0.0, 0.0]]), None, noise_std=np.array([[1.0, 2.0], [np.nan, np.nan]])
)
RADAR = small().model.radars[0]
REPORTED = Detections(
    np.array([[5e3, 0.3], [7e3, -2.0], [0.0, 1.0]]),
    None,
    noise_std=np.array([[50.0, 0.02], [np.nan, np.nan], [20.0, 0.02]]),
)
BIAS = SensorBias(80.0, 2e-3, np.radians(0.3), 0.5)
FOUND = Detections(np.array([[1000.0, 3.14], [90e3, -3.14]]), None, np.array([-1.0, 0.0]))


def test_measurements_and_noise_follow_from_the_linearised_measurement():
    np.testing.assert_array_equal(SENSOR.measure(STATE), [[90.0, 180.0], [-10.0, 30.0]])
    np.testing.assert_array_equal(SENSOR.noise_std_of(DETECTIONS), [[1.0, 2.0], [5.0, 5.0]])
    correlated = replace(DETECTIONS, noise_correlation=np.array([0.5, np.nan]))
    covariance = noise_covariance(SENSOR.noise_std_of(correlated), correlated.noise_correlation)
    np.testing.assert_array_equal(covariance, [[[1.0, 1.0], [1.0, 4.0]], 25.0 * np.eye(2)])


def test_detection_probability_is_learned_by_range_and_azimuth_from_the_sensor():
    trials = TrialSums(np.full(CELLS, 99.0), np.full(CELLS, 90.0), np.arange(float(CELLS)))
    factor, sensor = Detection(1000.0).after(trials), replace(SENSOR, yaw=0.5)
    place = np.array([[200.0, 0.3], [900.0, 2.0]])
    azimuth = place[:, 1]
    measured = place[:, :1] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    np.testing.assert_allclose(sensor.visibility.place(measured), place)
    view = factor.expect(View.of(sensor, Detections(measured, None)))
    found = view.detection_probability_at(np.full(2, 0.9), measured)
    np.testing.assert_array_equal(found, factor.probability(np.full(2, 0.9), place))


def test_pose_moves_the_sensor_and_keeps_the_rest():
    moved = SENSOR.at(Pose((1.0, 2.0), 0.5, (3.0, 4.0)))
    assert (moved.position, moved.yaw, moved.velocity) == ((1.0, 2.0), 0.5, (3.0, 4.0))
    assert (moved.std, moved.name) == ((5.0, 5.0), "mast")


def test_deviations_and_shares_are_the_detections_own():
    std = View.of(RADAR, REPORTED).detection_std
    np.testing.assert_array_equal(std, [[50.0, 0.02], RADAR.noise_std, [20.0, 0.02]])
    taken = View.of(RADAR, REPORTED, share=0.5).changed(complete=False).take(np.array([2, 0]))
    np.testing.assert_array_equal(taken.detection_std[:, 0], [20.0, 50.0])
    assert (taken.share, taken.complete) == (0.5, False)
    report = View.of(RADAR, REPORTED)
    assert report.project_as(REPORTED).detection_std is report.detection_std
    again = report.project_as(REPORTED.take(np.array([0])))
    assert len(again.detection_std) == 1


def test_covariances_in_the_plane_are_those_of_their_roots():
    plots = RADAR.in_plane(REPORTED)
    np.testing.assert_allclose(plots.covariance, plots.root @ plots.root.swapaxes(1, 2), atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(plots.covariance[0]), np.array([50.0, 5e3 * 0.02]) ** 2, rtol=1e-9
    )


def test_polar_radars_refuse_a_sensor_of_another_kind():
    with pytest.raises(TypeError, match="mast: PositionSensor given, must be a polar radar"):
        polar_radars([RADAR, SENSOR])


def test_errors_that_are_added_are_those_that_are_removed():
    stamp_ns, wrong = BIAS.apply_to(10**12, FOUND)
    assert stamp_ns == 10**12 + 5 * 10**8
    assert_allclose(wrong.measurement[:, 0], [1082.0, 90e3 * 1.002 + 80.0])
    # Beyond half a revolution it is counted from the other side.
    assert_allclose(wrong.measurement[0, 1], 3.14 + np.radians(0.3) - 2 * np.pi)
    assert wrong.time_s is not None
    again_ns, right = BIAS.remove_from(stamp_ns, wrong)
    assert again_ns == 10**12
    assert_allclose(right.measurement, FOUND.measurement, rtol=1e-12)


def test_no_errors_leave_a_report_as_it_is():
    assert NO_BIAS.remove_from(5, FOUND) == (5, FOUND)
    assert NO_BIAS.remove_from(5, FOUND)[1] is FOUND
    assert NO_BIAS.apply_to(5, FOUND)[1] is FOUND


def test_a_range_is_not_below_zero():
    near = Detections(np.array([[20.0, 0.0]]), None)
    assert BIAS.remove_from(0, near)[1].measurement[0, 0] == 0.0


@pytest.mark.parametrize("first", [NO_BIAS, BIAS, SensorBias(-30.0, -1e-3, 0.1, -2.0)])
def test_errors_that_are_left_after_others_are_removed_add_up(first):
    later = SensorBias(10.0, 1e-3, 0.02, 0.25)
    # Who has the first errors beside the later ones is right once both are removed.
    stamp_ns, found = first.apply_to(*later.apply_to(10**12, FOUND))
    whole_ns, whole = first.followed_by(later).remove_from(stamp_ns, found)
    assert whole_ns == 10**12
    assert_allclose(whole.measurement, FOUND.measurement, rtol=1e-9)
