import numpy as np
import pytest
from records import SHORT, record_of, shrunk

from phd_jdtc_ros.report.units import MapScale, metres_text, places_of


@pytest.mark.parametrize(
    ("record", "unit"),
    [
        (record_of(2), "km"),
        (shrunk(record_of(2)), "m"),
        (record_of(2, truth=(), filtered=(), smoothed=()), "km"),
        (shrunk(record_of(2, truth=(), filtered=(), smoothed=())), "m"),
        (record_of(2, truth=(), filtered=(), smoothed=(), plots=()), "km"),
    ],
)
def test_scale_is_metres_where_the_places_are_close(record, unit):
    assert MapScale.of(record).unit == unit


def test_scale_of_targets_ignores_detections_far_away():
    targets, far = shrunk(record_of(2)), record_of(2).plots

    assert MapScale.of(record_of(2, truth=targets.truth, filtered=(), smoothed=(), plots=far)) == (
        MapScale.of(targets)
    )


def test_places_of_a_record_are_in_metres():
    assert np.ptp(places_of(shrunk(record_of(2)))[:, 1]) == pytest.approx(2040.0 * SHORT)


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (103.4, "103 m"),
        (63.8, "64 m"),
        (9.96, "10 m"),
        (4.62, "4.6 m"),
        (0.462, "0.46 m"),
        (0.0, "0 m"),
    ],
)
def test_metres_text_has_two_digits_or_more(metres, text):
    assert metres_text(metres) == text
