import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.intake.clocks import AHEAD, Clocks, SentReport
from phd_jdtc_ros.core.types import Detections

S = 1_000_000_000
START = 1_770_000_000 * S
REACH_S, MAX_GAP_S = 3.0, 15.0
NOTHING = Detections(np.zeros((0, 2)), None)
SCANS, JUMP_SCAN = 30, 11
OFFSETS_S = (18.0, -18.0, 37.0, 3600.0, -3600.0)
ORDERS = {"in order": (0, 1, 2), "reversed": (2, 1, 0), "second first": (1, 0, 2)}


def clocks(sensors):
    return Clocks(sensors, REACH_S, MAX_GAP_S)


def sent(sensor, second):
    return SentReport(sensor, START + round(second * S), NOTHING)


def seconds(reports):
    """Return sensors and stamps as (sensor, second)."""
    return [(each.sensor, (each.stamp_ns - START) / S) for each in reports]


def fed(compared, *reports):
    """Return what is due of (sensor, second) reports, and what is left out."""
    due = [found for report in reports for found in compared.add(sent(*report))]
    return seconds(due), seconds(compared.take_left_out())


class TwoOrThree:
    """Sensors that report each second, one of them with a wrong clock from some scan on."""

    def __init__(self, sensors, wrong, offset_s, since, order, *, receipt=False):
        compared, self.due, self.left_out, self.offsets = clocks(sensors), [], [], []
        for scan in range(SCANS):
            for sensor in (each for each in order if each < sensors):
                off_s = offset_s if sensor == wrong and scan >= since else 0.0
                received_ns = START + scan * S + S // 10 if receipt else None
                found = compared.add(sent(sensor, scan + off_s), received_ns)
                self.due += [(scan, *each) for each in seconds(found)]
            self.left_out += compared.take_left_out()
            self.offsets.append(compared.offset_s(wrong))

    def of(self, sensor):
        """Return the seconds of a sensor's reports that were due."""
        return [second for _, own, second in self.due if own == sensor]


@pytest.mark.parametrize("offset_s", [*OFFSETS_S, REACH_S])
@pytest.mark.parametrize("sensors", [2, 3])
def test_add_leaves_out_a_sensor_whose_clock_goes_wrong(sensors, offset_s):
    for wrong, order in itertools.product(range(sensors), ORDERS.values()):
        run = TwoOrThree(sensors, wrong, offset_s, JUMP_SCAN, order)
        for good in set(range(sensors)) - {wrong}:
            assert run.of(good) == [*map(float, range(SCANS))]
        assert run.of(wrong) == [*map(float, range(JUMP_SCAN))]
        # The latest report waits for what the others do.
        assert len(run.left_out) == SCANS - JUMP_SCAN - 1
        assert run.offsets[:JUMP_SCAN] == [None] * JUMP_SCAN
        np.testing.assert_allclose(run.offsets[JUMP_SCAN + 1 :], offset_s, atol=1.0)


@pytest.mark.parametrize("offset_s", OFFSETS_S)
@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
def test_add_follows_two_of_three_clocks_that_differ_from_the_start(offset_s, order):
    for wrong in range(3):
        run = TwoOrThree(3, wrong, offset_s, 0, order)
        for good in {0, 1, 2} - {wrong}:
            assert run.of(good) == [*map(float, range(SCANS))]
        assert len(run.of(wrong)) <= 1
        np.testing.assert_allclose(run.offsets[1:], offset_s, atol=1.0)


@pytest.mark.parametrize("wrong", [0, 1])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_add_follows_the_earlier_of_two_clocks_or_the_one_near_the_receipt(wrong, order):
    for offset_s in OFFSETS_S:
        run = TwoOrThree(2, wrong, offset_s, 0, order, receipt=True)
        assert run.of(1 - wrong) == [*map(float, range(SCANS))]
        assert len(run.of(wrong)) <= 1
        # The receipt shows the offset of clocks to less than a scan.
        np.testing.assert_allclose(run.offsets[1:], offset_s, atol=1e-6)
    run = TwoOrThree(2, wrong, 37.0, 0, order)
    assert run.of(1 - wrong) == [*map(float, range(SCANS))]


def test_add_leaves_out_single_stamps_of_one_sensor_or_several():
    for sensors, far in itertools.product((1, 2), (86400.0, -86400.0)):
        others = [(1, second) for second in range(8)] if sensors > 1 else []
        stream = sorted([*((0, second) for second in range(8)), *others], key=lambda each: each[1])
        stream.insert(len(stream) // 2, (0, far))
        due, left_out = fed(clocks(sensors), *stream)
        assert due == [each for each in stream if each[1] != far]
        assert left_out == [(0, far)]


def test_add_takes_back_a_sensor_whose_clock_is_set_right():
    compared = clocks(2)
    both = [(sensor, second) for second in range(4) for sensor in (0, 1)]
    fed(compared, *both, (0, 4), (1, 104), (0, 5), (1, 105), (0, 6))
    assert compared.offset_s(1) == 99.0
    due, left_out = fed(compared, (1, 7), (0, 7))
    assert (due, left_out) == ([(1, 7), (0, 7)], [(1, 105)])
    assert compared.offset_s(1) is None


@pytest.mark.parametrize("to", [-500, 500])
def test_add_loses_nothing_where_all_sensors_jump(to):
    both = [(sensor, second) for second in range(6) for sensor in (0, 1)]
    behind = [(sensor, second + to) for sensor, second in both]
    for sensors in (1, 2):
        first, second = ([each for each in part if each[0] < sensors] for part in (both, behind))
        due, left_out = fed(clocks(sensors), *first, *second)
        assert (due, left_out) == ([*first, *second], [])


def test_add_loses_nothing_of_a_short_recording_that_starts_again():
    once = [(0, 4 * revolution) for revolution in range(5)]
    compared = Clocks(1, 12.0, 60.0)
    assert fed(compared, *once, *once, *once) == ([*once, *once, *once], [])


def test_add_follows_one_sensor_once_the_others_are_silent():
    compared = clocks(2)
    both = [(sensor, second) for second in range(4) for sensor in (0, 1)]
    alone = [(1, 1000 + second) for second in range(8)]
    due, left_out = fed(compared, *both, *alone)
    assert (due, left_out) == ([*both, *alone], [])
    # A sensor that was left out has less weight than the one that comes back.
    fed(compared := clocks(2), *both, (0, 4), (1, 104), (0, 5), *((1, k) for k in range(105, 112)))
    due, _ = fed(compared, (0, 13), (1, 113), (0, 14))
    assert due == [(0, 13), (0, 14)]
    assert compared.offset_s(1) == 99.0


def test_add_leaves_out_a_sensor_whose_stamps_are_in_the_future_from_the_start():
    # An offset of less than the longest delay is seen by the receipt alone.
    for order in ((0, 1), (1, 0)):
        run = TwoOrThree(2, 1, 2.0, 0, order, receipt=True)
        assert run.of(0) == [*map(float, range(SCANS))]
        assert len(run.of(1)) <= 2
        np.testing.assert_allclose(run.offsets[3:], 2.0, atol=1e-6)


def test_reset_leaves_out_what_is_held_back():
    compared = clocks(1)
    fed(compared, (0, 0), (0, 1000))
    compared.reset()
    assert fed(compared, (0, 5)) == ([(0, 5)], [(0, 1000)])


def test_the_first_report_of_a_sensor_contradicts_nobody():
    # The second sensor is late, and the third has two reports before its first one.
    reports = [(0, 0.0), (2, 0.0), (2, 1.75), (1, 0.0), (2, 3.5), (1, 2.0), (0, 5.0)]
    compared = clocks(3)
    due, left_out = fed(compared, *reports)
    assert (sorted(due), left_out) == (sorted(reports), [])


def test_a_sensor_is_right_once_time_passes_the_first_stamp_that_was_ahead():
    reports = [(1, 0.0), (0, 0.0), (1, 2.2), (1, 4.4), (0, 2.5), (1, 6.6), (0, 5.0)]
    compared = clocks(2)
    due, left_out = fed(compared, *reports)
    assert (sorted(due), left_out) == (sorted(reports), [])


@st.composite
def streams(draw):
    """Return sensors with right clocks, and their reports as they come, with pauses of some."""
    sensors = draw(st.integers(1, 4))
    arrivals = []
    for sensor in range(sensors):
        # A report that is later than others' by more is ahead of theirs by more than it may be.
        period_s, late_s = draw(st.floats(0.2, 6.0)), draw(st.floats(0.0, 0.95 * AHEAD * REACH_S))
        pause = draw(st.integers(0, 40))
        for number in range(round(30.0 / period_s)):
            second = round(number * period_s, 3)
            if not pause <= second < pause + draw(st.sampled_from([0, 0, 8, 20])):
                arrivals.append((second + late_s, sensor, second))
    return sensors, [(sensor, second) for _, sensor, second in sorted(arrivals)]


@settings(deadline=None, max_examples=150)
@given(case=streams())
def test_add_leaves_out_nothing_of_right_clocks(case):
    sensors, stream = case
    compared = clocks(sensors)
    due, left_out = fed(compared, *stream)
    compared.reset()
    held = seconds(compared.take_left_out())
    assert left_out == []
    assert sorted(due + held) == sorted(stream)
    # Only the end of the stream can still be held back.
    assert all(second > 30.0 - MAX_GAP_S for _, second in held)


def random_s(second):
    """Return an offset that is another one each second."""
    return np.random.default_rng(second).uniform(-20.0, 20.0)


@pytest.mark.parametrize("receipt", [False, True])
@pytest.mark.parametrize(
    "off_s",
    [random_s, lambda second: 5.0 - 10.0 * (second % 2), lambda second: 30.0 * np.sin(second)],
    ids=["random", "alternating", "swinging"],
)
def test_no_clock_however_wrong_takes_the_others_along(off_s, receipt):
    compared, due = clocks(3), []
    for second in range(120):
        for sensor in range(3):
            stamp_s = round(second + off_s(second) * (sensor == 1), 6)
            received_ns = START + second * S if receipt else None
            due += seconds(compared.add(sent(sensor, stamp_s), received_ns))
    for good in (0, 2):
        assert [second for sensor, second in due if sensor == good] == [*map(float, range(120))]


def test_a_sensor_that_is_late_takes_over_from_silent_ones_without_a_jump_back():
    both = [(sensor, second) for second in range(8) for sensor in (0, 1)]
    late = [each for k in range(8) for each in ((0, 16 + k), (1, 8 + k))]
    alone = [(0, second) for second in range(8, 16)], [(1, second) for second in range(16, 30)]
    due, _ = fed(clocks(2), *both, *alone[0], *late, *alone[1])
    stamps = [second for _, second in due]
    assert (np.maximum.accumulate(stamps) - stamps <= REACH_S).all()
    assert stamps[-10:] == [*range(20, 30)]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_clock_that_was_never_set_is_wrong(order):
    run = TwoOrThree(2, 1, -1.77e9, 0, order)
    assert run.of(0) == [*map(float, range(SCANS))]
    assert len(run.of(1)) <= 1
