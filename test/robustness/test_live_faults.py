"""A bounded part of ``make faults`` and ``make fuzz`` on live nodes with few particles."""

import pytest

from robustness import (
    bad_scans,
    engines,
    late_sectors,
    moving,
    publishers,
    raw_bytes,
    recordings,
    stamps_and_time,
    turning,
)

pytestmark = pytest.mark.live

CASES = bad_scans.cases()
every_engine = pytest.mark.parametrize("engine", engines.ALL)


@pytest.fixture(autouse=True)
def _numpy_kernels(monkeypatch):
    # Nodes start in half the time, and few particles take none to speak of.
    monkeypatch.setenv("PHD_JDTC_KERNELS", "numpy")


def test_there_are_as_many_cases_as_there_have_to_be():
    assert len(CASES) >= 30
    assert len({case.name for case in CASES}) == len(CASES)


@every_engine
def test_tracker_counts_every_bad_scan_and_loses_no_good_one(engine):
    with engines.using(engine):
        figure = bad_scans.measure()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_outlives_mutated_bytes_beside_a_good_publisher():
    figure = raw_bytes.measure(seconds=1.0)
    assert figure.reached, (figure.measured, figure.details)


def test_full_disk_ends_the_recording_and_not_the_tracking():
    figure = recordings.measure_full()
    if figure.measured is None:
        pytest.skip(figure.reason)
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_resets_once_a_loop_and_never_on_a_shuffle():
    figure = stamps_and_time.measure_time_faults(loops=1, duration_s=240.0)
    assert figure.reached, (figure.measured, figure.details)


def test_second_publisher_is_an_error_and_a_restarted_driver_is_none():
    figure = publishers.measure(restarts=1, run_s=4.0)
    assert figure.reached, (figure.measured, figure.details)


@every_engine
def test_tracker_bridges_and_counts_the_faults_of_a_turning_radar_and_keeps_its_target(engine):
    with engines.using(engine):
        figure = turning.measure()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_works_in_late_sectors_and_bounds_a_burst_of_them():
    with engines.using(engines.GAUSSIAN):
        figure = late_sectors.measure()
    assert figure.reached, (figure.measured, figure.details)


def test_tracker_counts_the_faults_of_a_moving_radars_poses_and_keeps_its_target():
    with engines.using(engines.GAUSSIAN):
        figure = moving.measure()
    assert figure.reached, (figure.measured, figure.details)


def test_detection_probabilities_that_are_none_are_refused():
    figure = turning.measure_refused()
    assert figure.reached, (figure.measured, figure.details)
