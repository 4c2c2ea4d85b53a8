import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.models import detection_limit
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Coverage, Detections

RADAR = small().model.radars[1]


def crowd(count, amplitude):
    rng = np.random.default_rng(0)
    measurement = np.stack([rng.uniform(0, 17e3, count), rng.uniform(-np.pi, np.pi, count)], axis=1)
    return Detections(measurement, amplitude)


AMPLITUDES = {
    "none": None,
    "equal": np.full(20_000, 30.0),
    "noise": np.sqrt(
        RADAR.threshold**2 + 2.0 * np.random.default_rng(1).standard_exponential(20_000)
    ),
}


def limited(predicted, targets, detections, radar):
    """Return the detections, the sensor and the share of an incomplete report."""
    mass = np.array([targets])
    report = detection_limit.limit_detections(Report(radar, detections), predicted, mass)
    assert not report.complete
    return report.detections, report.sensor, report.share


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr(detection_limit, "MAX_CANDIDATES", 5000)


PREDICTED = crowd(1000, None).measurement


def test_a_crowd_has_a_threshold_or_bound_beyond_what_can_be_afforded():
    few = crowd(100, np.full(100, 5.0))
    report = Report(RADAR, few)
    assert detection_limit.limit_detections(report, PREDICTED, np.array([4.0])) is report
    amplitude = np.where(np.arange(20_000) < 10, 30.0, np.nan)
    kept, raised, _ = limited(PREDICTED, 4.0, crowd(20_000, amplitude), RADAR)
    assert np.isnan(kept.amplitude).sum() == len(kept) - 10
    assert (raised.threshold, np.isfinite(raised.clutter_rate)) == (30.0, True)
    count = detection_limit.MAX_DETECTIONS + 1000
    many = crowd(count, np.full(count, 30.0))
    kept, crowded, _ = limited(PREDICTED[:0], 0.0, many, RADAR)
    assert len(kept) == crowded.clutter_rate == detection_limit.MAX_UNEXPLAINED
    kept, _, _ = limited(PREDICTED[:0], float(count), many, RADAR)
    assert len(kept) == detection_limit.MAX_DETECTIONS


@pytest.mark.parametrize(("targets", "kept"), [(4.0, 4096), (5990.0, 6000)])
def test_many_detections_are_used_if_targets_explain_them(monkeypatch, targets, kept):
    monkeypatch.setattr(detection_limit, "MAX_CANDIDATES", 1 << 22)
    report = Report(RADAR, crowd(6000, np.full(6000, 30.0)))
    assert (
        len(detection_limit.limit_detections(report, PREDICTED[:10], np.array([targets]))) == kept
    )


def test_with_amplitudes_the_threshold_is_raised():
    amplitude = AMPLITUDES["noise"]
    many = crowd(20_000, amplitude)
    kept, raised, share = limited(PREDICTED, 1e6, many, RADAR)
    assert share == 1.0
    assert RADAR.candidate_count(PREDICTED, kept) < 1.2 * detection_limit.MAX_CANDIDATES
    assert sorted(kept.amplitude) == sorted(amplitude)[-len(kept) :]
    assert raised.threshold == kept.amplitude.min()
    # If all may be targets, clutter is above the new threshold as often as it was above the old
    # one, and of one density.
    part = raised.clutter_rate / RADAR.clutter_rate
    assert part == pytest.approx(len(kept) / 20_000, rel=0.1)
    np.testing.assert_allclose(
        raised.log_clutter_intensity(kept), RADAR.log_clutter_intensity(kept), rtol=1e-12
    )


@pytest.mark.parametrize("amplitudes", AMPLITUDES)
def test_a_crowd_that_no_target_explains_is_clutter(amplitudes):
    many = crowd(20_000, AMPLITUDES[amplitudes])
    kept, crowded, _ = limited(PREDICTED, 4.0, many, RADAR)
    assert crowded.clutter_rate == len(kept) - 4.0
    density = np.exp(crowded.log_clutter_intensity(crowd(20_000, None)))
    area = 2.0 * np.pi * RADAR.clutter_max_range
    np.testing.assert_allclose(density * area, len(kept) - 4.0)


def test_a_crowd_of_a_sector_is_clutter_of_that_sector():
    sector = Coverage(0.0, 0.1)
    azimuths = [1.0, sector.width / (2.0 * np.pi)]
    many = Detections(
        crowd(20_000, None).measurement * azimuths + [0.0, 0.05], None, coverage=sector
    )
    kept, crowded, _ = limited(PREDICTED, 4.0, many, RADAR)
    density = np.exp(crowded.log_clutter_intensity(kept))
    area = sector.width * RADAR.clutter_max_range
    np.testing.assert_allclose(density * area, len(kept) - 4.0)


@pytest.mark.parametrize("amplitudes", ["none", "equal"])
def test_without_an_order_of_amplitudes_an_even_draw_is_kept(amplitudes):
    many = crowd(20_000, AMPLITUDES[amplitudes])
    kept, raised, share = limited(PREDICTED, 1e6, many, RADAR)
    assert RADAR.candidate_count(PREDICTED, kept) < 1.2 * detection_limit.MAX_CANDIDATES
    if amplitudes == "none":
        assert share == len(kept) / 20_000
        assert raised.clutter_rate == pytest.approx(share * RADAR.clutter_rate)
    quarters = np.histogram(kept.measurement[:, 1], 4, (-np.pi, np.pi))[0]
    assert quarters.max() < 1.3 * quarters.min()
