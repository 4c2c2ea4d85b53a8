import signal

import pytest

from phd_jdtc_ros import interruption

SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


@SIGNALS
def test_signal_interrupts_only_where_it_is_accepted(number):
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), interruption.accepted():
        signal.raise_signal(number)
    assert signal.getsignal(number) is before


@SIGNALS
def test_signal_in_a_step_waits_for_the_end_of_the_outermost_one(number):
    done = []

    def work():
        with interruption.step():
            with interruption.step():
                signal.raise_signal(number)
                done.append("inner")
            done.append("outer")
        done.append("after")

    with pytest.raises(KeyboardInterrupt), interruption.accepted():
        work()
    assert done == ["inner", "outer"]


def test_error_of_a_step_ends_it_as_without_a_signal():
    with pytest.raises(ValueError, match="fault"), interruption.accepted(), interruption.step():
        raise ValueError("fault")
    with interruption.accepted(), interruption.step():
        pass  # Nothing is left to wait for
