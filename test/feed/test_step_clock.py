import time

import pytest

from phd_jdtc_ros.feed.step_clock import StepClock


def work(milliseconds):
    until = time.thread_time() + 1e-3 * milliseconds
    while time.thread_time() < until:
        pass


def test_step_clock_counts_the_work_of_blocks_by_step():
    clock = StepClock()
    with clock:
        work(20.0)
    work(200.0)
    with clock:
        work(10.0)
        assert clock.take_ms() == pytest.approx(30.0, abs=15.0)
    clock = StepClock()
    with clock:
        work(60.0)
        first = clock.take_ms()
        work(20.0)
        assert [first, clock.take_ms()] == pytest.approx([60.0, 20.0], abs=15.0)


def test_step_clock_forgets_discarded_work():
    clock = StepClock()
    with clock:
        work(60.0)
        clock.discard()
    with clock:
        assert clock.take_ms() < 15.0
