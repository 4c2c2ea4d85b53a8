"""The parameters of a hand-over."""

import pytest
from refusals import faults_of
from two_regions import MARGIN, REGIONS, given

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED
from phd_jdtc_ros.handover import settings


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trackers": ["west"]}, "trackers: ['west'] given, must be two names or more"),
        (
            {"west.region": []},
            "west.region: [] given, must be [x_min, y_min, x_max, y_max, margin]",
        ),
        ({"east.region": [1.0, 0.0, 0.0, 1.0]}, "east.region: [1.0, 0.0, 0.0, 1.0] given"),
        ({"west.node": "/east/tracker"}, "west.node: no longer a parameter, remap its topics"),
        ({"west.speed": 1.0}, "west.speed: unknown parameter"),
        ({"west.region": REGIONS["west"]}, "west.region: margin 0 given, must be above 0"),
        (
            {"east.region": [-1e3, 0.0, 60e3, 60e3, MARGIN]},
            "east.region: [-1000, 0, 60000, 60000] given, must not overlap west.region",
        ),
    ],
)
def test_parameters_that_do_not_fit_are_reported(changes, words):
    assert any(fault.startswith(words) for fault in faults_of(settings.resolve, given(**changes)))


def test_two_trackers_of_one_name_are_one_fault():
    assert faults_of(settings.resolve, given(trackers=["west", "west"])) == [
        "trackers: ['west', 'west'] given, must be a list of distinct names, at most 50"
    ]


def test_defaults_follow_from_the_margin_and_the_names():
    assert settings.resolve(given()).hysteresis == pytest.approx(0.2 * MARGIN)
    found = settings.resolve(given())
    assert found.topic(0, FILTERED) == "/west/tracker/filtered/estimates"
    assert found.topic(1, SMOOTHED) == "/east/tracker/smoothed/estimates"
