import pytest

from phd_jdtc_ros.asterix.clocks import NS_PER_DAY, NS_PER_TICK, RadarClock, StreamClock
from phd_jdtc_ros.asterix.messages import DAY, NONE, TRUNCATED, Plot, ServiceMessage

NS = 10**9
# The 22nd of November 2026.
MIDNIGHT = 20_779 * NS_PER_DAY


def clock_of(midnight=0, **shared):
    """Return the clock of a radar that is alone on its stream."""
    return RadarClock(StreamClock(midnight, **shared))


def message(time_of_day, period=DAY):
    """Return a plot of this time, or a service message."""
    if period == DAY:
        return ServiceMessage(1, time_of_day, 1, 0.0, 0.0)
    return Plot(1, time_of_day, period, 0.0, 0.0)


def seconds(clock, time_s, received_s=None, check_clock=True, midnight=0):
    """Return the time of a message, seconds since a midnight, that is received then."""
    received = None if received_s is None else midnight + round(received_s * NS)
    time = round(time_s * 128) % DAY
    found = clock.time_ns(message(time), received, check_clock)
    return (found - midnight) / NS


def test_times_go_on_over_days_and_do_not_jump_around_midnight():
    clock = clock_of(MIDNIGHT)
    true = [3600.0 * hour for hour in range(0, 100, 5)]
    found = [seconds(clock, time_s, midnight=MIDNIGHT) for time_s in true]
    assert found == true
    clock = clock_of(MIDNIGHT)
    true = [86_399.0, 86_400.5, 86_399.5, 86_401.0, 86_398.0, 86_402.0]
    assert [seconds(clock, time_s, midnight=MIDNIGHT) for time_s in true] == true


@pytest.mark.parametrize("received", [86_399.9, 86_400.2, 86_401.0])
def test_day_is_that_of_the_receipt_on_both_sides_of_midnight(received):
    for true in (86_399.5, 86_400.0, 86_400.5):
        clock = clock_of()
        assert seconds(clock, true, received, midnight=MIDNIGHT) == true


def test_each_radar_has_its_own_day():
    # Seven hours apart, as clocks in local time and UTC are.
    stream = StreamClock(MIDNIGHT)
    clocks = ((RadarClock(stream), 0.0), (RadarClock(stream), 7 * 3600.0))
    for hour in range(60):
        for clock, ahead in clocks:
            found = seconds(clock, hour * 3600.0 + ahead, midnight=MIDNIGHT)
            assert found == hour * 3600.0 + ahead


@pytest.mark.parametrize("off", [3600.0, -3600.0, 40_000.0, 30.0])
def test_times_of_a_wrong_clock_are_shifted_and_counted(off):
    clock = clock_of(max_offset_s=10.0)
    found = [seconds(clock, k + off, k + 0.25, midnight=MIDNIGHT) for k in range(50_000, 50_010)]
    assert clock.counts == {"clock_off": 1}
    # The error that the third message shows is used from then on.
    assert found[2:] == [k + 0.25 for k in range(50_002, 50_010)]
    assert clock.offset_s == pytest.approx(0.25 - off)


def test_a_clock_that_is_set_right_is_not_shifted_any_more():
    clock = clock_of(max_offset_s=10.0)
    for k in range(5):
        seconds(clock, k + 2000, k + 1000, midnight=MIDNIGHT)
    found = [seconds(clock, k, k + 0.5, midnight=MIDNIGHT) for k in range(1005, 1010)]
    assert found[-1] == 1009.0
    assert clock.counts == {"clock_off": 2}


def test_single_old_messages_do_not_make_a_clock_wrong():
    clock = clock_of(max_offset_s=10.0)
    for k in range(1000, 1030):
        time_s = k - 25.0 if k % 3 == 0 else float(k)
        assert seconds(clock, time_s, k + 0.5, midnight=MIDNIGHT) == time_s
    assert not clock.counts


def test_plots_of_a_radar_with_service_messages_do_not_judge_its_clock():
    clock = clock_of(max_offset_s=10.0)
    for k in range(1000, 1010):
        seconds(clock, k - 100.0, k, check_clock=False, midnight=MIDNIGHT)
    assert not clock.counts


def test_message_without_a_time_has_that_of_its_receipt_or_the_one_before():
    clock = clock_of(MIDNIGHT)
    other = RadarClock(clock.stream)
    assert clock.time_ns(message(NONE), None, True) is None
    assert clock.time_ns(message(NONE), 77 * NS, True) == 77 * NS
    seconds(clock, 500.0)
    assert clock.time_ns(message(DAY), None, True) == MIDNIGHT + 500 * NS
    assert other.time_ns(message(2**24 - 1), None, True) == MIDNIGHT + 500 * NS
    assert clock.counts + other.counts == {"no_time": 3, "time_unknown": 1}


def test_truncated_times_go_on_over_their_wraps():
    clock = clock_of(MIDNIGHT)
    clock.time_ns(message(1000 * 128), None, True)
    for time_s in range(1000, 4000, 100):
        truncated = message(time_s * 128 % TRUNCATED, TRUNCATED)
        assert clock.time_ns(truncated, None, True) == MIDNIGHT + time_s * NS


@pytest.mark.parametrize("received", [86_399.0, 86_400.25, 86_403.0])
def test_truncated_times_begin_again_at_midnight(received):
    for true in (86_398.5, 86_399.75, 86_400.0, 86_401.5):
        truncated = message(round(true * 128) % DAY % TRUNCATED, TRUNCATED)
        found = clock_of().time_ns(truncated, MIDNIGHT + round(received * NS), True)
        assert (found - MIDNIGHT) / NS == true


def test_a_tick_is_exact():
    assert NS_PER_TICK * 128 == NS
    found = clock_of(MIDNIGHT).time_ns(message(12_345_67), None, True)
    assert found == MIDNIGHT + 1_234_567 * 7_812_500
