"""Systematic errors of simulated radars."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.visibility import sector_probability
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

CONFIG = resolve(
    {
        "sensors": ["one", "other"],
        **{
            f"{name}.{key}": value
            for name in ("one", "other")
            for key, value in {
                "rotation_s": 4.0,
                "fields.time": "time",
                "fields.amplitude": "",
                "max_range": 1e5,
                "clutter_max_range": 1e5,
            }.items()
        },
    }
)
DOCUMENT = {"interval_s": 1.0, "scans": 25, "traffic": {"aircraft": 5, "seed": 3}}
ERRORS = {"range_bias": 80.0, "range_gain": 1e-3, "azimuth_bias_deg": 0.3, "time_offset_s": 0.5}


def reports(**document):
    scene = scenario_file.resolve({**DOCUMENT, **document}, CONFIG.model.radars)
    return simulate_reports(scene, CONFIG.inputs, seed=1)


def test_a_radar_has_the_errors_that_a_scenario_gives_it_and_the_others_none():
    exact, wrong = reports(), reports(biases={"other": ERRORS})
    for radar in (0, 1):
        before = [report for report in exact if report.radar == radar]
        after = [report for report in wrong if report.radar == radar]
        assert len(before) == len(after) > 4
        for right, biased in zip(before, after, strict=True):
            # The antenna reports north before it is there.
            late_s = radar * (0.5 - 4.0 * 0.3 / 360.0)
            assert biased.stamp_ns - right.stamp_ns == pytest.approx(late_s * 1e9, abs=1.0)
            assert len(right.detections)
            distance = right.detections.measurement[:, 0]
            off = biased.detections.measurement - right.detections.measurement
            assert_allclose(off[:, 0], radar * (80.0 + 1e-3 * distance), atol=1e-6)
            # Clockwise is negative here.
            turned = np.mod(off[:, 1] + np.pi, 2 * np.pi) - np.pi
            assert_allclose(np.degrees(turned), -0.3 * radar, atol=1e-9)
            until_stamp = biased.detections.time_s - right.detections.time_s
            assert_allclose(until_stamp, radar * 0.5 - late_s, atol=1e-9)
    assert [r.stamp_ns for r in wrong] == sorted(r.stamp_ns for r in wrong)


def test_a_misaligned_antenna_cuts_its_sectors_at_its_reported_azimuth():
    layouts = [replace(layout, sectors=16) for layout in CONFIG.inputs]
    document = {**DOCUMENT, "biases": {"other": {"azimuth_bias_deg": 5.0}}}
    scene = scenario_file.resolve(document, CONFIG.model.radars)
    found = [report.detections for report in simulate_reports(scene, layouts, seed=1)]
    assert sum(map(len, found)) > 50
    for detections in found:
        assert sector_probability(detections.measurement[:, 1], detections.coverage).all()
