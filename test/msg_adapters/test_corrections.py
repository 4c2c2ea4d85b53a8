"""Systematic errors are removed as messages are read."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from msg_adapters.readers import reader_of
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.radar_build import bias_parameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import Detections

STAMP_NS = 1_000_250_000_000
ERRORS = {
    "range_bias": 80.0,
    "range_gain": 2e-3,
    "azimuth_bias_deg": 0.3,
    "time_offset_s": -0.25,
}
TRUE = Detections(np.array([[5000.0, 0.5], [9000.0, -2.0]]), np.array([3.0, 4.0]), np.zeros(2))


def inputs(errors, **changes):
    given = {"sensors": ["mast"], **{f"mast.{name}": value for name, value in changes.items()}}
    return resolve({**given, **{f"mast.{k}": v for k, v in errors.items()}}).inputs[0]


LAYOUTS = {
    "counter-clockwise": {},
    "compass": {"azimuth_convention": "compass_cw", "azimuth_unit": "deg"},
    "epoch": {"fields.time": "time", "time_reference": "epoch"},
    "radar_scan": {"message": "radar_scan"},
    "radar_scan, compass": {"message": "radar_scan", "azimuth_convention": "compass_cw"},
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_report_is_read_without_its_radars_errors(layout):
    radar = inputs(ERRORS, **layout)
    assert radar.bias.azimuth < 0 if layout.get("azimuth_unit") else radar.bias.azimuth > 0
    stamp_ns, wrong = radar.bias.apply_to(STAMP_NS, TRUE)
    reader = reader_of(radar)
    report = reader.from_cdr(reader.to_cdr(wrong, stamp_ns, radar), radar)
    assert report.stamp_ns == STAMP_NS
    assert_allclose(report.detections.measurement, TRUE.measurement, rtol=1e-6)
    if radar.time_field:
        # Relative to the stamp, which is as late as they are.
        assert_allclose(report.detections.time_s, 0.0, atol=1e-6)
    assert not report.dropped


def test_without_errors_a_report_is_what_it_was_to_the_bit():
    plain, zero = inputs({}), inputs(dict.fromkeys(ERRORS, 0.0))
    assert plain == zero
    data = reader_of(plain).to_cdr(TRUE, STAMP_NS, plain)
    report = reader_of(plain).from_cdr(data, zero)
    assert report.stamp_ns == STAMP_NS
    assert_array_equal(report.detections.measurement, TRUE.measurement.astype(np.float32))


def test_ranges_within_the_error_become_zero_and_impossible_ones_stay_impossible():
    radar = inputs(ERRORS)
    near = Detections(np.array([[30.0, 0.1], [-5.0, 0.1]]), np.ones(2))
    report = reader_of(radar).from_cdr(reader_of(radar).to_cdr(near, STAMP_NS, radar), radar)
    assert_array_equal(report.detections.measurement[:, 0], [0.0])
    assert report.dropped == {"range": 1}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_errors_become_the_parameters_that_they_came_from(layout):
    radar = inputs(ERRORS, **layout)
    found = bias_parameters(radar, radar.bias)
    assert found == pytest.approx({f"mast.{name}": value for name, value in ERRORS.items()})


def test_absurd_errors_are_refused_with_what_is_allowed():
    with pytest.raises(ConfigError) as caught:
        inputs({"range_gain": -1.0, "time_offset_s": 1e3, "azimuth_bias_deg": "left"})
    text = str(caught.value)
    assert "mast.range_gain: -1.0 given, must be" in text
    assert "mast.time_offset_s: 1000.0 given, must be" in text
    assert "mast.azimuth_bias_deg: 'left' given, must be" in text


def test_a_replay_in_lock_step_expects_older_answers_of_a_radar_whose_clock_is_late():
    usual = resolve({"sensors": ["mast"]}).answer_delay_s
    late = resolve({"sensors": ["mast"], "mast.time_offset_s": 0.75}).answer_delay_s
    early = resolve({"sensors": ["mast"], "mast.time_offset_s": -0.75}).answer_delay_s
    assert (usual, late, early) == (0.0, 0.75, 0.0)
