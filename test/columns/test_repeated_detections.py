"""A driver that repeats its buffer: each of a report's detections counts once."""

from pathlib import Path

import numpy as np
import pytest
from samples import STAMP_NS, radar

from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.columns.selection import select
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.parameter_files import from_arguments

NS = 10**9
PROFILE = Path(__file__).parents[2] / "config" / "surveillance.yaml"


def columns(count, **more):
    """Return the columns of so many detections at one place."""
    ones = np.ones(count)
    given = {"range": 5e3 * ones, "azimuth": 0.5 * ones, "amplitude": 20.0 * ones}
    return given | {name: value * ones for name, value in more.items()}


def test_select_counts_identical_detections_once_and_reports_them():
    report = select(STAMP_NS, radar(), columns(500))
    assert len(report.detections) == 1
    assert report.anomalies == {"detections_repeated": 499}
    assert not report.dropped
    report = select(STAMP_NS, radar(), columns(3))
    (text,) = anomalies.of(radar(), report.anomalies)
    assert text.startswith("2 detections that repeat another one")
    assert len(select(STAMP_NS, radar(), columns(2, level=np.nan)).detections) == 1


@pytest.mark.parametrize(
    ("field", "named"),
    [
        ("level", {}),
        ("time", {"time_field": "time"}),
        ("height", {"height_field": "height"}),
        ("code", {"code_field": "code"}),
        ("address", {"address_field": "address"}),
        ("detection_type", {"detection_type_field": "kind"}),
        ("range_std", {"range_std_field": "range_std"}),
        ("azimuth_std", {"azimuth_std_field": "azimuth_std"}),
        ("range_rate", {"range_rate_field": "range_rate"}),
        ("range_rate_std", {"range_rate_field": "r", "range_rate_std_field": "s", "range_rate": 1}),
    ],
)
def test_select_keeps_detections_that_differ_in_anything(field, named):
    names = {name: value for name, value in named.items() if name.endswith("_field")}
    fixed = {name: value for name, value in named.items() if not name.endswith("_field")}
    given = columns(2, **fixed, **{field: np.array([1.0, 2.0])})
    assert len(select(STAMP_NS, radar(**names), given).detections) == 2


def test_select_keeps_the_order_of_the_others():
    ranges = np.array([3e3, 1e3, 3e3, 2e3, 1e3])
    ones = np.ones(len(ranges))
    report = select(
        STAMP_NS, radar(), {"range": ranges, "azimuth": 0.5 * ones, "amplitude": 20.0 * ones}
    )
    assert report.detections.measurement[:, 0].tolist() == [3e3, 1e3, 2e3]


def test_a_repeated_buffer_is_one_target_that_is_never_lost():
    given = from_arguments.load(PROFILE)
    of_one = {name: value for name, value in given.items() if not name.startswith("radar_2.")}
    config = from_arguments.config_of({**of_one, "sensors": ["radar_1"]})
    pipeline = new_pipeline(config)
    found = []
    for scan in range(30):
        stamp_ns = STAMP_NS + round(scan * config.model.modes.interval_s * NS)
        report = select(stamp_ns, config.inputs[0], columns(500 if scan in range(5, 8) else 1))
        for event in pipeline.add(0, stamp_ns, report.detections):
            if isinstance(event, Stepped):
                found += [len(own) for own in event.step.filtered]
    assert found[4:] == [1] * len(found[4:])
    assert len(found) >= 29
