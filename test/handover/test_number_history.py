from phd_jdtc_ros.handover import number_history
from phd_jdtc_ros.handover.number_history import FORGOTTEN_S, Numbers

NS = 10**9
WEST = 0


def test_numbers_of_tracks_that_are_no_more_are_forgotten():
    numbers = Numbers(0)
    numbers.add(0, {(WEST, 3): 1})
    assert numbers.at(0) == {(WEST, 3): 1}
    numbers.add(round(FORGOTTEN_S + 1.0) * NS, {})
    assert numbers.at(0) == {}


def test_number_at_a_stamp_is_that_of_its_time():
    numbers = Numbers(2 * NS)
    for stamp, number in ((0, 1), (1, 1), (4, 2), (5, 2)):
        numbers.add(stamp * NS, {(WEST, 3): number})
    found = [numbers.at(stamp * NS)[WEST, 3] for stamp in (0, 1, 2, 4, 9)]
    assert found == [1, 1, 2, 2, 2]
    # Its next number is too far ahead: it has its last one still.
    assert Numbers(0).at(0) == {}
    late = Numbers(1 * NS)
    late.add(0, {(WEST, 3): 1})
    late.add(9 * NS, {(WEST, 3): 2})
    assert late.at(5 * NS) == {(WEST, 3): 1}


def test_numbers_of_tracks_are_bounded(monkeypatch):
    monkeypatch.setattr(number_history, "MOST_TRACKS", 10)
    numbers = Numbers(0)
    for stamp in range(20):
        numbers.add(stamp, {(0, stamp): stamp})
    assert numbers.at(19) == {(0, stamp): stamp for stamp in range(10, 20)}
