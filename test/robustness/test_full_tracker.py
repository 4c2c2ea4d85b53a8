"""A bounded part of ``make faults`` and ``make soak`` on live trackers as users have them."""

import pytest

from robustness.operation import soak, warm_restart
from robustness.reports import clutter, stamps_and_time

pytestmark = pytest.mark.live


def test_tracker_does_not_grow_over_a_short_run():
    figure = soak.measure(60)
    assert figure.details["scans"] == 60
    assert figure.details["not_finite"] == 0
    assert (figure.details["descriptors"], figure.details["threads"]) == (0, 0)


def test_tracker_restarts_after_long_gaps_only_and_does_not_grow():
    figure = stamps_and_time.measure_gap()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_keeps_its_targets_through_a_burst_of_false_detections():
    """`crowd` asks for more, without a node."""
    figure = clutter.measure(false_detections=300, count=2)
    assert figure.details, figure.measured
    # How long a scan takes is for `make faults`, where nothing else keeps the machine busy.
    assert figure.details["after_m"] <= clutter.MOST_RATIO * figure.details["quiet_m"]


def test_restarted_tracker_is_soon_as_good_as_one_that_never_stopped():
    """Without a lost scan it is the same; see `test_warm_restart`."""
    figure = warm_restart.measure((21,), compare_cold=False)
    assert figure.reached, (figure.measured, figure.details)
