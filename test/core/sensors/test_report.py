"""Reports: a sensor with its detections, and columns that are computed once."""

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections

RADAR = small().model.radars[0]
DETECTIONS = Detections(
    np.array([[5e3, 0.3], [7e3, -2.0], [0.0, 1.0]]),
    None,
    noise_std=np.array([[50.0, 0.02], [np.nan, np.nan], [20.0, 0.02]]),
)


def test_deviations_and_shares_are_the_detections_own():
    std = Report(RADAR, DETECTIONS).detection_std
    np.testing.assert_array_equal(std, [[50.0, 0.02], RADAR.noise_std, [20.0, 0.02]])
    taken = Report(RADAR, DETECTIONS, share=0.5, complete=False).take(np.array([2, 0]))
    np.testing.assert_array_equal(taken.detection_std[:, 0], [20.0, 50.0])
    assert (taken.share, taken.complete) == (0.5, False)
    report = Report(RADAR, DETECTIONS)
    assert report.project_as(DETECTIONS).detection_std is report.detection_std
    again = report.project_as(DETECTIONS.take(np.array([0])))
    assert len(again.detection_std) == 1


def test_covariances_in_the_plane_are_those_of_their_roots():
    plots = Report(RADAR, DETECTIONS).in_plane
    np.testing.assert_allclose(plots.covariance, plots.root @ plots.root.swapaxes(1, 2), atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(plots.covariance[0]), np.array([50.0, 5e3 * 0.02]) ** 2, rtol=1e-9
    )


def test_polar_radars_refuse_a_sensor_of_another_kind():
    class Other:
        name = "harbour"

    with pytest.raises(TypeError, match="harbour: Other given, must be a polar radar"):
        polar_radars([RADAR, Other()])
