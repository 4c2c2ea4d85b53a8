from dataclasses import replace

import numpy as np
import pytest
from lone import lone, scan_at

from phd_jdtc_ros.core.models.detection_clusters import merge_clusters
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.types import UNKNOWN, Detections

GIVEN = {
    "radar.cluster_distance": 3.0,
    "radar.fields.range_rate": "rr",
    "radar.range_std": 0.01,
    "radar.azimuth_std_deg": 0.01,
}
MODEL = lone(GIVEN).model
(RADAR,) = MODEL.radars


def at(*places):
    """Return (range, azimuth) of places in the sensor's frame."""
    x, y = np.transpose(places).astype(float)
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)


def places(found):
    distance, azimuth = found.measurement.T
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=1)


def test_detections_of_one_vehicle_become_one_for_the_engine():
    report = Detections(at((-50, 0.5), (20, 5), (-51, -0.5)), np.array([4.0, 6.0, 9.0]))
    found = merge_clusters(report, RADAR)
    np.testing.assert_allclose(places(found), [[-50.5, 0.0], [20.0, 5.0]], atol=1e-9)
    np.testing.assert_array_equal(found.amplitude, [9.0, 6.0])
    scan = scan_at(0.0, at((50, 0), (51, 0), (90, 9)))
    (found,) = MODEL.reports(scan)
    assert len(found) == 2


def test_detections_with_other_range_rates_stay_apart_but_for_folds():
    rate = np.array([5.0, 5.2, -8.0, np.nan])
    report = Detections(at((50, 0), (51, 0), (50.5, 1), (90, 0)), None, range_rate=rate)
    found = merge_clusters(report, RADAR)
    np.testing.assert_allclose(found.range_rate, [5.1, -8.0, np.nan])
    radar = replace(RADAR, range_rate=RangeRateModel(0.1, 20.0))
    report = Detections(at((50, 0), (51, 0)), None, range_rate=np.array([9.9, -9.9]))
    found = merge_clusters(report, radar)
    assert len(found) == 1
    assert abs(found.range_rate[0]) == pytest.approx(10.0)


def test_without_a_distance_detections_stay_as_they_are():
    # Each is near the next one; none is as long as the row.
    report = Detections(at(*((40 + 2.5 * k, 0) for k in range(9))), None)
    assert len(merge_clusters(report, RADAR)) >= 3
    report = Detections(at((50, 0), (50, 0.1)), None)
    assert merge_clusters(report, replace(RADAR, cluster_distance=0.0)) is report


def test_noise_may_be_what_sets_detections_of_one_vehicle_apart():
    radar = replace(RADAR, azimuth_std=np.radians(1.0))
    # A degree is 2.6 m at 150 m, and their difference has that times the root of two.
    across, along = at((150, -2.5), (150, 2.5)), at((147.5, 0), (152.5, 0))
    assert len(merge_clusters(Detections(across, None), radar)) == 1
    assert len(merge_clusters(Detections(along, None), radar)) == 2


def test_deviations_and_times_of_a_group_are_their_means():
    report = Detections(
        at((50, 0), (51, 0)),
        None,
        time_s=np.array([0.0, 0.2]),
        noise_std=np.array([[1.0, np.nan], [3.0, np.nan]]),
        noise_correlation=np.array([0.5, 0.7]),
        range_rate=np.array([1.0, 1.0]),
        range_rate_std=np.array([0.2, np.nan]),
    )
    found = merge_clusters(report, RADAR)
    np.testing.assert_allclose(found.time_s, [0.1])
    np.testing.assert_array_equal(found.noise_std, [[2.0, np.nan]])
    np.testing.assert_allclose(found.noise_correlation, [0.6])
    np.testing.assert_array_equal(found.range_rate_std, [0.2])


def test_a_group_has_the_identity_that_is_known_and_the_kind_of_the_most_sensors():
    report = Detections(
        at((50, 0), (51, 0), (90, 9)),
        None,
        code=np.array([UNKNOWN, 0o1234, UNKNOWN]),
        sensor_type=np.array([1, 3, 1]),
    )
    found = merge_clusters(report, RADAR)
    assert found.code.tolist() == [0o1234, UNKNOWN]
    assert found.sensor_type.tolist() == [3, 1]


def test_detections_with_other_codes_or_addresses_stay_apart():
    report = Detections(at((50, 0), (51, 0), (50, 1)), None)
    codes = np.array([0o1234, 0o4321, UNKNOWN])
    for found in (replace(report, code=codes), replace(report, address=codes)):
        assert len(merge_clusters(found, RADAR)) == 2
