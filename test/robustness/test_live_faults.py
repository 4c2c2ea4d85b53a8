# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bounded part of ``make faults``, ``make soak`` and ``make fuzz`` on live nodes."""

import pytest

from robustness import (
    bad_scans,
    clutter,
    publishers,
    raw_bytes,
    recordings,
    soak,
    stamps_and_time,
    warm_restart,
)

CASES = bad_scans.cases()


def test_there_are_as_many_cases_as_there_have_to_be():
    assert len(CASES) >= 30
    assert len({case.name for case in CASES}) == len(CASES)


def test_tracker_counts_every_bad_scan_and_loses_no_good_one():
    figure = bad_scans.measure()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_outlives_mutated_bytes_beside_a_good_publisher():
    figure = raw_bytes.measure(seconds=1.0)
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_does_not_grow_over_a_short_run():
    figure = soak.measure(60)
    assert figure.details["scans"] == 60
    assert figure.details["not_finite"] == 0
    assert (figure.details["descriptors"], figure.details["threads"]) == (0, 0)


def test_full_disk_ends_the_recording_and_not_the_tracking():
    figure = recordings.measure_full()
    if figure.measured is None:
        pytest.skip(figure.reason)
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_starts_again_only_after_long_gaps_and_does_not_grow():
    figure = stamps_and_time.measure_gap()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_resets_once_a_loop_and_never_on_a_shuffle():
    figure = stamps_and_time.measure_time_faults(loops=1, duration_s=60.0)
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_keeps_its_targets_through_a_burst_of_false_detections():
    figure = clutter.measure(false_detections=300, count=2)
    assert figure.reached, (figure.measured, figure.details)


def test_restarted_tracker_is_soon_as_good_as_one_that_never_stopped():
    figure = warm_restart.measure((21,))
    assert figure.reached, (figure.measured, figure.details)


def test_second_publisher_is_an_error_and_a_restarted_driver_is_none():
    figure = publishers.measure(restarts=1, run_s=4.0)
    assert figure.reached, (figure.measured, figure.details)
