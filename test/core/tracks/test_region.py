import numpy as np
import pytest
import sweep
from scenes import small

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import Detections

SQUARE = Region(-10.0, 0.0, 10.0, 40.0, margin=5.0)


def test_depth_is_the_distance_to_the_nearest_side():
    places = np.array([[0.0, 20.0], [9.0, 20.0], [0.0, 1.0], [12.0, 20.0], [12.0, -7.0]])
    assert SQUARE.depth(places).tolist() == [10.0, 1.0, 1.0, -2.0, -7.0]
    assert SQUARE.covers(places).tolist() == [True, True, True, True, False]


def test_detections_beyond_the_margin_are_not_seen():
    radar = small().model.radars[0]
    place = np.array([[0.0, 20.0], [14.0, 20.0], [16.0, 20.0], [0.0, 46.0]])
    line = place - np.asarray(radar.position)
    azimuth = np.arctan2(line[:, 1], line[:, 0]) - radar.yaw
    amplitude = np.arange(4.0)
    seen = Detections(np.stack([np.hypot(*line.T), azimuth], axis=1), amplitude)
    kept = SQUARE.select_detections(seen, radar)
    assert kept.amplitude.tolist() == [0.0, 1.0]
    assert Region(-1e3, -1e3, 1e3, 1e3).select_detections(seen, radar) is seen


@pytest.mark.parametrize(
    "given", [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0, 0.0]], ids=str
)
def test_a_region_that_is_none_is_refused(given):
    with pytest.raises(ConfigError, match=r"region: .* must be empty or"):
        small({"region": given})


def test_a_rate_that_is_learned_is_that_of_a_whole_field():
    given = {"region": [0.0, 0.0, 1.0, 1.0], "radar_2.clutter_rate": "auto"}
    with pytest.raises(ConfigError, match=r"radar_2\.clutter_rate: auto given with a region"):
        small(given)


@pytest.mark.parametrize("late_reports", ["drop", "rework"])
def test_a_tracker_of_a_region_has_the_targets_in_it_and_no_others(late_reports):
    # Two of the four targets are east of the seam, all the time.
    given = {"engine": "gaussian", "estimates_period_s": 1.7, "lag": "4 s"}
    region = {"region": [0.0, -90e3, 90e3, 90e3, 2e3]}
    found = {}
    for name, more in (("whole", {}), ("east", region)):
        config = sweep.configuration({**given, **more, "late_reports": late_reports})
        pipeline, steps = new_pipeline(config), []
        reports = sweep.sector_reports(5, timed=True)
        # One is late, and is cut and limited in its place.
        reports.insert(55, reports.pop(50))
        for report in reports:
            events = pipeline.add(*report)
            if not isinstance(events, Rejection):
                steps += [event for event in events if isinstance(event, Stepped)]
        for step in steps:
            assert name == "whole" or all(
                (config.region.select_detections(report, config.model.radars[0]) is report)
                for report in step.scan.detections
            )
        found[name] = [one for step in steps for one in step.step.filtered]
        smoothed = [one for event in pipeline.flush() for one in event.smoothed]
        assert name == "whole" or all((one.position[:, 0] >= -2e3).all() for one in smoothed)
    for whole, east in zip(found["whole"][-4:], found["east"][-4:], strict=True):
        assert whole.stamp_ns == east.stamp_ns
        truth = sweep.position_at(sweep.seconds_of(east.stamp_ns))[[0, 3]]
        assert (truth[:, 0] > 0.0).all()
        for estimates in (whole, east):
            apart = np.hypot(*(truth[:, None] - estimates.position).transpose(2, 0, 1))
            assert (apart.min(axis=1) < 500.0).all()
        assert (east.position[:, 0] >= -2e3).all()
        assert (whole.position[:, 0] < -2e3).sum() >= 2
