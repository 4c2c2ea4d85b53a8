from collections import Counter

import pytest

from phd_jdtc_ros.asterix.clocks import NS_PER_DAY, NS_PER_TICK, StreamClock
from phd_jdtc_ros.asterix.messages import DAY, NONE, TRUNCATED

NS = 10**9
# The 22nd of November 2026.
MIDNIGHT = 20_779 * NS_PER_DAY
RADAR = 0x0102


def seconds(clock, time_s, received_s=None, radar=RADAR, check_clock=True, counts=None, midnight=0):
    """Return the time of a message, seconds since a midnight, that is received then."""
    received = None if received_s is None else midnight + round(received_s * NS)
    time = round(time_s * 128) % DAY
    counts = Counter() if counts is None else counts
    found = clock.time_ns(radar, time, DAY, received, check_clock, counts)
    return (found - midnight) / NS


def test_times_of_a_recording_go_on_over_days():
    clock = StreamClock(MIDNIGHT)
    true = [3600.0 * hour for hour in range(0, 100, 5)]
    found = [seconds(clock, time_s, midnight=MIDNIGHT) for time_s in true]
    assert found == true


def test_times_do_not_jump_where_messages_around_midnight_are_out_of_order():
    clock = StreamClock(MIDNIGHT)
    true = [86_399.0, 86_400.5, 86_399.5, 86_401.0, 86_398.0, 86_402.0]
    assert [seconds(clock, time_s, midnight=MIDNIGHT) for time_s in true] == true


@pytest.mark.parametrize("received", [86_399.9, 86_400.2, 86_401.0])
def test_day_is_that_of_the_receipt_on_both_sides_of_midnight(received):
    for true in (86_399.5, 86_400.0, 86_400.5):
        clock = StreamClock()
        assert seconds(clock, true, received, midnight=MIDNIGHT) == true


def test_each_radar_has_its_own_day():
    # Seven hours apart, as clocks in local time and UTC are.
    clock = StreamClock(MIDNIGHT)
    for hour in range(60):
        for radar, ahead in ((1, 0.0), (2, 7 * 3600.0)):
            found = seconds(clock, hour * 3600.0 + ahead, radar=radar, midnight=MIDNIGHT)
            assert found == hour * 3600.0 + ahead


@pytest.mark.parametrize("off", [3600.0, -3600.0, 40_000.0, 30.0])
def test_times_of_a_wrong_clock_are_shifted_and_counted(off):
    clock, counts = StreamClock(max_offset_s=10.0), Counter()
    found = [
        seconds(clock, k + off, k + 0.25, counts=counts, midnight=MIDNIGHT)
        for k in range(50_000, 50_010)
    ]
    assert counts == {"clock_off": 1}
    # The error that the third message shows is used from then on.
    assert found[2:] == [k + 0.25 for k in range(50_002, 50_010)]
    assert clock.offset_s[RADAR] == pytest.approx(0.25 - off)


def test_a_clock_that_is_set_right_is_not_shifted_any_more():
    clock, counts = StreamClock(max_offset_s=10.0), Counter()
    for k in range(5):
        seconds(clock, k + 2000, k + 1000, counts=counts, midnight=MIDNIGHT)
    found = [
        seconds(clock, k, k + 0.5, counts=counts, midnight=MIDNIGHT) for k in range(1005, 1010)
    ]
    assert found[-1] == 1009.0
    assert counts == {"clock_off": 2}


def test_single_old_messages_do_not_make_a_clock_wrong():
    clock, counts = StreamClock(max_offset_s=10.0), Counter()
    for k in range(1000, 1030):
        time_s = k - 25.0 if k % 3 == 0 else float(k)
        assert seconds(clock, time_s, k + 0.5, counts=counts, midnight=MIDNIGHT) == time_s
    assert not counts


def test_plots_of_a_radar_with_service_messages_do_not_judge_its_clock():
    clock, counts = StreamClock(max_offset_s=10.0), Counter()
    for k in range(1000, 1010):
        seconds(clock, k - 100.0, k, check_clock=False, counts=counts, midnight=MIDNIGHT)
    assert not counts


def test_message_without_a_time_has_that_of_its_receipt_or_the_one_before():
    clock, counts = StreamClock(MIDNIGHT), Counter()
    assert clock.time_ns(RADAR, NONE, DAY, None, True, counts) == MIDNIGHT
    assert clock.time_ns(RADAR, NONE, DAY, 77 * NS, True, counts) == 77 * NS
    seconds(clock, 500.0)
    assert clock.time_ns(RADAR, DAY, DAY, None, True, counts) == MIDNIGHT + 500 * NS
    assert clock.time_ns(9, 2**24 - 1, DAY, None, True, counts) == MIDNIGHT + 500 * NS
    assert counts == {"no_time": 4}


def test_truncated_times_go_on_over_their_wraps():
    clock = StreamClock(MIDNIGHT)
    clock.time_ns(RADAR, 1000 * 128, DAY, None, True, Counter())
    for time_s in range(1000, 4000, 100):
        ticks = time_s * 128 % TRUNCATED
        found = clock.time_ns(RADAR, ticks, TRUNCATED, None, True, Counter())
        assert found == MIDNIGHT + time_s * NS


@pytest.mark.parametrize("received", [86_399.0, 86_400.25, 86_403.0])
def test_truncated_times_begin_again_at_midnight(received):
    for true in (86_398.5, 86_399.75, 86_400.0, 86_401.5):
        ticks = round(true * 128) % DAY % TRUNCATED
        at = MIDNIGHT + round(received * NS)
        found = StreamClock().time_ns(RADAR, ticks, TRUNCATED, at, True, Counter())
        assert (found - MIDNIGHT) / NS == true


def test_a_tick_is_exact():
    assert NS_PER_TICK * 128 == NS
    clock = StreamClock(MIDNIGHT)
    assert clock.time_ns(RADAR, 12_345_67, DAY, None, True, Counter()) == (
        MIDNIGHT + 1_234_567 * 7_812_500
    )
