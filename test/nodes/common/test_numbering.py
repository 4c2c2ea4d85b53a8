from itertools import chain, count, islice
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st

from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.nodes.common.health import LASTING_S, StatusLog
from phd_jdtc_ros.nodes.common.topics import WINDOW, SequenceNumbers

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


def received(numbers):
    numbering = SequenceNumbers()
    for number in numbers:
        numbering.add(number)
    return numbering


def in_turns(*publishers):
    return list(chain.from_iterable(zip(*publishers, strict=True)))


@given(st.lists(st.integers(1, 10**6), min_size=1), st.integers(1, 10**9))
def test_what_one_publisher_lost_is_counted_exactly(steps, first):
    numbers = [first]
    for step in steps:
        numbers.append(numbers[-1] + step)
    assert received(numbers).lost == numbers[-1] - first + 1 - len(numbers)
    assert not received(numbers).several


# Messages published before the tracker discovered the new one do not count as lost.
@pytest.mark.parametrize(("alive", "missed"), [(1, 0), (2, 0), (5, 0), (5, 3), (99, 0), (99, 3)])
def test_restart_is_neither_a_loss_nor_a_second_publisher(alive, missed):
    numbering = received(range(1, alive + 1))
    for number in range(1 + missed, 2 * alive + 20):
        numbering.add(number)
        assert (numbering.lost, numbering.several) == (0, False)


def test_restarts_and_random_numbers_take_no_losses_or_memory():
    numbering = SequenceNumbers()
    for _ in range(5):
        for number in range(1, WINDOW + 1):
            numbering.add(number)
            assert not numbering.several
    assert numbering.lost == 0
    numbers = [998, 999, 1000, *range(1, 996), 1004, 1005]
    assert received(numbers).lost == 8
    numbering = received(islice(((7919 * k) % 100_003 for k in count(1)), 10_000))
    assert len(numbering._sequences) <= WINDOW + 1


@pytest.mark.parametrize("offset", [0, 1, 2, 1000, -1000])
def test_two_that_publish_in_turns_are_seen_within_two_scans_of_each(offset):
    numbers = in_turns(range(5000, 5002), range(5000 + offset, 5002 + offset))
    numbering = received([*range(4990, 5000), *numbers, 5002])
    assert numbering.several


@pytest.mark.parametrize("offset", [0, 1, 2, 7, 1000, -1000])
def test_two_that_publish_in_turns_lose_nothing(offset):
    numbers = in_turns(range(5000, 5100), range(5000 + offset, 5100 + offset))
    assert received(numbers).lost == 0


@pytest.mark.parametrize("offset", [1000, -1000])
def test_losses_of_two_publishers_are_counted_exactly(offset):
    one, other = list(range(5000, 5100)), list(range(5000 + offset, 5100 + offset))
    both = in_turns(one, other)
    for gone in (one[10], one[11], one[50], other[30], other[31], other[32]):
        both.remove(gone)
    assert received(both).lost == 6


def test_second_publisher_is_no_loss_and_forgotten_once_it_has_gone():
    numbering = received([1000, 5000, 5001])
    assert numbering.lost == 3999
    numbering.add(1001)
    assert numbering.lost == 0
    numbering.add(1003)
    assert numbering.lost == 1
    numbering = received(in_turns(range(100, 110), range(1, 11)))
    assert numbering.several
    for number in range(110, 110 + WINDOW):
        numbering.add(number)
    assert not numbering.several


def said(*looks):
    """Return what is logged of looks: seconds, level and message of the status `north`."""
    found, now = [], [0.0]
    levels = ("info", "warning", "error")
    logger = {level: lambda text, level=level: found.append((level, text)) for level in levels}
    log = StatusLog(SimpleNamespace(**logger), lambda: now[0])
    for now[0], level, text in looks:
        log.take([diagnostics.status("north", {}, level, text)])
    return found


def test_every_lasting_cause_is_logged_once_and_what_goes_by_is_not():
    silent = [(t, STALE, f"silent for {t:.1f} s") for t in range(20)]
    well = [(t, OK, "receiving") for t in range(20, 40)]
    assert said((-9, OK, "receiving"), *silent, *well) == [
        ("warning", f"north: silent for {LASTING_S:.1f} s"),
        ("info", "north: receiving again"),
    ]
    quiet = [(t, STALE, "silent") for t in range(9)]
    shared = [(t, ERROR, "several publishers") for t in range(9, 20)]
    assert [level for level, _ in said(*quiet, *shared)] == ["warning", "error"]
    assert not said(*((t, (OK, WARN)[t % 2], "xy"[t % 2]) for t in range(50)))
