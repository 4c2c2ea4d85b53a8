"""What was learned of sensors, on the report's page."""

from dataclasses import replace

import pytest
from records import record_of

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.learned.outliers import Outliers
from phd_jdtc_ros.report.page import score_words
from phd_jdtc_ros.report.record import learned_values, sensor_changes

INPUTS = resolve(
    {
        "sensors": ["mast"],
        "mast.range_std": "auto 50",
        "mast.azimuth_std_deg": "auto 0.2",
        "mast.detection_probability": "auto 0.9",
    }
).inputs
FIGURES = {
    "mast.detection_probability": 0.6,
    "mast.detection_probability_std": 0.02,
    "mast.detection_probability_set": 0.9,
    "mast.range_noise_ratio": 2.0,
    "mast.range_noise_ratio_std": 0.1,
    "mast.azimuth_noise_ratio": 0.5,
    "mast.azimuth_noise_ratio_std": 0.05,
}


def test_values_are_those_learned_in_the_units_of_parameters():
    found = {each.quantity: each for each in learned_values(INPUTS, FIGURES)}
    assert found["detection_probability"][2:] == (0.9, 0.6, 0.02, "")
    assert found["range_std"][2:] == (50.0, 100.0, 5.0, "m")
    assert found["azimuth_std_deg"][2:5] == pytest.approx((0.2, 0.1, 0.01))
    shares = learned_values(INPUTS, {"mast.outlier_share": 0.2, "mast.outlier_share_std": 0.02})
    assert [tuple(each) for each in shares] == [
        ("mast", "share of outliers", Outliers.start, 0.2, 0.02, "")
    ]
    assert not list(learned_values(INPUTS, {"other.range_noise_ratio": 2.0}))


def test_page_shows_what_was_set_and_found_of_which_sensor():
    record = replace(record_of(), learned=tuple(learned_values(INPUTS, FIGURES)))
    text = score_words.sensors(record.learned, {})
    cells = ("mast", "range_std", "50 m", "100 m", "5 m")
    assert "".join(f"<td>{cell}</td>" for cell in cells[1:]) in text
    changes = sensor_changes(INPUTS, {**FIGURES, "mast.fewer_detections": 1.0})
    text = score_words.sensors(tuple(learned_values(INPUTS, FIGURES)), changes)
    assert "<strong>mast</strong>: has changed: it detects fewer targets." in text
    assert sensor_changes(INPUTS, FIGURES) == {}
    assert score_words.sensors((), {}) == ""
