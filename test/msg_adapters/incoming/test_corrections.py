"""Systematic errors are removed as messages are read."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from reference import resolve

from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import Detections

STAMP_NS = 1_000_250_000_000
# Range, m; range gain; azimuth, degrees; time, s.
ERRORS = [80.0, 2e-3, 0.3, -0.25]
NONE = [0.0, 0.0, 0.0, 0.0]
TRUE = Detections(np.array([[5000.0, 0.5], [9000.0, -2.0]]), np.array([3.0, 4.0]), np.zeros(2))


def inputs(biases, **changes):
    given = {"sensors": ["mast"], **{f"mast.{name}": value for name, value in changes.items()}}
    return resolve({**given, "mast.biases": biases}).inputs[0]


LAYOUTS = {
    "counter-clockwise": {},
    "compass": {"units.azimuth_convention": "compass_cw", "units.azimuth": "deg"},
    "epoch": {"fields.time": "time", "units.time_reference": "epoch"},
    "radar_scan": {"message": "radar_scan"},
    "radar_scan, compass": {"message": "radar_scan", "units.azimuth_convention": "compass_cw"},
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_report_is_read_without_its_radars_errors(layout):
    radar = inputs(ERRORS, **layout)
    assert radar.bias.azimuth < 0 if layout.get("units.azimuth") else radar.bias.azimuth > 0
    stamp_ns, wrong = radar.bias.apply_to(STAMP_NS, TRUE)
    reader = reader_of(radar)
    report = reader.from_cdr(reader.to_cdr(wrong, stamp_ns, radar), radar)
    assert report.stamp_ns == STAMP_NS
    assert_allclose(report.detections.measurement, TRUE.measurement, rtol=1e-6)
    if radar.fields.time:
        # Relative to the stamp, which is as late as they are.
        assert_allclose(report.detections.time_s, 0.0, atol=1e-6)
    assert not report.dropped


def test_a_report_without_errors_or_with_impossible_ranges_stays_so():
    (plain,), zero = resolve({"sensors": ["mast"]}).inputs, inputs(NONE)
    assert plain == zero
    data = reader_of(plain).to_cdr(TRUE, STAMP_NS, plain)
    report = reader_of(plain).from_cdr(data, zero)
    assert report.stamp_ns == STAMP_NS
    assert_array_equal(report.detections.measurement, TRUE.measurement.astype(np.float32))
    radar = inputs(ERRORS)
    near = Detections(np.array([[30.0, 0.1], [-5.0, 0.1]]), np.ones(2))
    report = reader_of(radar).from_cdr(reader_of(radar).to_cdr(near, STAMP_NS, radar), radar)
    assert_array_equal(report.detections.measurement[:, 0], [0.0])
    assert report.dropped == {"range": 1}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_errors_become_the_parameters_that_they_came_from(layout):
    radar = inputs(ERRORS, **layout)
    assert radar.bias_parameters(radar.bias) == {"mast.biases": pytest.approx(ERRORS)}


@pytest.mark.parametrize(
    "biases",
    [
        *([2e5, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 181.0, 0.0]),
        *([0.0, 0.0, 0.0, 1e3], [0.0] * 3, [0.0] * 5, ["left", 0.0, 0.0, 0.0], 80.0),
    ],
)
def test_absurd_errors_are_refused_with_what_is_allowed(biases):
    with pytest.raises(ConfigError) as caught:
        inputs(biases)
    (fault,) = caught.value.faults
    assert fault.startswith(f"mast.biases: {biases} given, must be 4 numbers: range within 100000")


def test_a_replay_in_lock_step_expects_older_answers_of_a_radar_whose_clock_is_late():
    usual = resolve({"sensors": ["mast"]}).answer_delay_s
    late = resolve({"sensors": ["mast"], "mast.biases": [0.0, 0.0, 0.0, 0.75]}).answer_delay_s
    early = resolve({"sensors": ["mast"], "mast.biases": [0.0, 0.0, 0.0, -0.75]}).answer_delay_s
    assert (usual, late, early) == (0.0, 0.75, 0.0)
