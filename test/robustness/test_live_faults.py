"""A bounded part of ``make faults`` and ``make fuzz`` on live nodes."""

import pytest

from robustness.hostile_input import raw_bytes
from robustness.operation import publishers, recordings, user_files
from robustness.reports import bad_scans, late_sectors, moving, stamps_and_time, turning

pytestmark = pytest.mark.live

CASES = bad_scans.cases()


def test_there_are_as_many_cases_as_there_have_to_be():
    assert len(CASES) >= 30
    assert len({case.name for case in CASES}) == len(CASES)


def test_full_disk_ends_the_recording_and_not_the_tracking():
    figure = recordings.measure_full()
    if figure.measured is None:
        pytest.skip(figure.reason)
    assert figure.reached, (figure.measured, figure.details)


@pytest.mark.parametrize(
    "module", [bad_scans, turning, late_sectors, moving], ids=lambda module: module.__name__
)
def test_tracker_counts_faults_of_its_input_and_keeps_its_targets(module):
    figure = module.measure()
    assert figure.reached, (figure.measured, figure.details)


@pytest.mark.parametrize(
    ("measure", "bounds"),
    [
        (raw_bytes.measure, {"seconds": 1.0}),
        (stamps_and_time.measure_time_faults, {"loops": 1, "duration_s": 240.0}),
        (stamps_and_time.measure_numbers, {"loops": 1, "length": 6}),
        (stamps_and_time.measure_clocks, {"offsets_s": (37.0,)}),
        (publishers.measure, {"restarts": 1, "run_s": 4.0}),
        (turning.measure_refused, {}),
        (user_files.measure_written, {"kinds": ("a user's file", "a pipe")}),
        (user_files.measure_parameters, {"nodes": ("evaluator",)}),
    ],
    ids=[
        *("mutated bytes", "resets", "numbers", "clocks", "publishers", "refused probabilities"),
        *("files of users", "parameter files"),
    ],
)
def test_tracker_reaches_the_goal_of_a_shorter_fault(measure, bounds):
    figure = measure(**bounds)
    assert figure.reached, (figure.measured, figure.details)
