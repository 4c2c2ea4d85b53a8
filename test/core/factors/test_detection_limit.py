"""Reports of more detections than can be used, and of several detections of one vehicle."""

from dataclasses import replace

import numpy as np
import pytest
from lone import lone, scan_at
from scenes import small

from phd_jdtc_ros.core.factors import limit
from phd_jdtc_ros.core.models.detection_clusters import merge_clusters
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import UNKNOWN, Coverage, Detections

CROWDED = small().model.radars[1]
AMPLITUDES = {
    "none": None,
    "equal": np.full(20_000, 30.0),
    "noise": np.sqrt(
        CROWDED.threshold**2 + 2.0 * np.random.default_rng(1).standard_exponential(20_000)
    ),
}
GIVEN = {
    "radar.cluster_distance": 3.0,
    "radar.fields.range_rate": "rr",
    "radar.range_std": 0.01,
    "radar.azimuth_std_deg": 0.01,
}
MODEL = lone(GIVEN).model
(RADAR,) = MODEL.radars


def crowd(count, amplitude):
    rng = np.random.default_rng(0)
    measurement = np.stack([rng.uniform(0, 17e3, count), rng.uniform(-np.pi, np.pi, count)], axis=1)
    return Detections(measurement, amplitude)


def limited(predicted, targets, detections, radar):
    """Return the incomplete report, given predicted measurements and a number of targets."""
    mass = np.array([targets])
    report = limit.limit_detections(View.of(radar, detections), predicted, mass)
    assert not report.complete
    return report


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr(limit, "MAX_CANDIDATES", 5000)


PREDICTED = crowd(1000, None).measurement


def test_a_crowd_has_a_threshold_or_bound_beyond_what_can_be_afforded():
    few = crowd(100, np.full(100, 5.0))
    report = View.of(CROWDED, few)
    assert limit.limit_detections(report, PREDICTED, np.array([4.0])) is report
    amplitude = np.where(np.arange(20_000) < 10, 30.0, np.nan)
    kept = limited(PREDICTED, 4.0, crowd(20_000, amplitude), CROWDED)
    assert np.isnan(kept.detections.amplitude).sum() == len(kept) - 10
    assert (kept.sensor.threshold, np.isfinite(kept.clutter_rate)) == (30.0, True)
    count = limit.MAX_DETECTIONS + 1000
    many = crowd(count, np.full(count, 30.0))
    kept = limited(PREDICTED[:0], 0.0, many, CROWDED)
    assert len(kept) == kept.clutter_rate == limit.MAX_UNEXPLAINED
    kept = limited(PREDICTED[:0], float(count), many, CROWDED)
    assert len(kept) == limit.MAX_DETECTIONS


@pytest.mark.parametrize(("targets", "kept"), [(4.0, 4096), (5990.0, 6000)])
def test_many_detections_are_used_if_targets_explain_them(monkeypatch, targets, kept):
    monkeypatch.setattr(limit, "MAX_CANDIDATES", 1 << 22)
    report = View.of(CROWDED, crowd(6000, np.full(6000, 30.0)))
    assert len(limit.limit_detections(report, PREDICTED[:10], np.array([targets]))) == kept


def test_with_amplitudes_the_threshold_is_raised():
    amplitude = AMPLITUDES["noise"]
    many = crowd(20_000, amplitude)
    kept = limited(PREDICTED, 1e6, many, CROWDED)
    found = kept.detections.amplitude
    assert kept.share == 1.0
    assert (
        CROWDED.of_gaussians.candidate_count(PREDICTED, kept.detections)
        < 1.2 * limit.MAX_CANDIDATES
    )
    assert sorted(found) == sorted(amplitude)[-len(kept) :]
    assert kept.sensor.threshold == found.min()
    # If all may be targets, clutter is above the new threshold as often as it was above the old
    # one, and of one density.
    part = kept.clutter_rate / CROWDED.clutter_rate
    assert part == pytest.approx(len(kept) / 20_000, rel=0.1)
    np.testing.assert_allclose(
        kept.log_clutter, View.of(CROWDED, kept.detections).log_clutter, rtol=1e-12
    )


@pytest.mark.parametrize("amplitudes", AMPLITUDES)
def test_a_crowd_that_no_target_explains_is_clutter(amplitudes):
    many = crowd(20_000, AMPLITUDES[amplitudes])
    kept = limited(PREDICTED, 4.0, many, CROWDED)
    assert kept.clutter_rate == len(kept) - 4.0
    density = np.exp(kept.changed(detections=crowd(20_000, None)).log_clutter)
    area = 2.0 * np.pi * CROWDED.visibility.clutter_range
    np.testing.assert_allclose(density * area, len(kept) - 4.0)


def test_a_crowd_of_a_sector_is_clutter_of_that_sector():
    sector = Coverage(0.0, 0.1)
    azimuths = [1.0, sector.width / (2.0 * np.pi)]
    many = Detections(
        crowd(20_000, None).measurement * azimuths + [0.0, 0.05], None, coverage=sector
    )
    kept = limited(PREDICTED, 4.0, many, CROWDED)
    density = np.exp(kept.log_clutter)
    area = sector.width * CROWDED.visibility.clutter_range
    np.testing.assert_allclose(density * area, len(kept) - 4.0)


@pytest.mark.parametrize("amplitudes", ["none", "equal"])
def test_without_an_order_of_amplitudes_an_even_draw_is_kept(amplitudes):
    many = crowd(20_000, AMPLITUDES[amplitudes])
    kept = limited(PREDICTED, 1e6, many, CROWDED)
    assert (
        CROWDED.of_gaussians.candidate_count(PREDICTED, kept.detections)
        < 1.2 * limit.MAX_CANDIDATES
    )
    if amplitudes == "none":
        assert kept.share == len(kept) / 20_000
        assert kept.clutter_rate == pytest.approx(kept.share * CROWDED.clutter_rate)
    quarters = np.histogram(kept.detections.measurement[:, 1], 4, (-np.pi, np.pi))[0]
    assert quarters.max() < 1.3 * quarters.min()


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
        detection_type=np.array([1, 3, 1]),
    )
    found = merge_clusters(report, RADAR)
    assert found.code.tolist() == [0o1234, UNKNOWN]
    assert found.detection_type.tolist() == [3, 1]


def test_detections_with_other_codes_or_addresses_stay_apart():
    report = Detections(at((50, 0), (51, 0), (50, 1)), None)
    codes = np.array([0o1234, 0o4321, UNKNOWN])
    for found in (replace(report, code=codes), replace(report, address=codes)):
        assert len(merge_clusters(found, RADAR)) == 2
