import math
from itertools import permutations

import numpy as np
import pytest
from estimate_sets import of_tracks

from phd_jdtc_ros.handover.picture import (
    KEPT_S,
    SERIES,
    TARGETS_OF_A_STAMP,
    Gathering,
    Refusal,
    TrackSeries,
    too_many,
)

NS = 10**9


def at(stamp):
    return of_tracks({}, stamp_ns=stamp * 10**9)


def add(gathering, tracker, stamp):
    """Return what a report closes: stamps, with the trackers that are in each."""
    closed = gathering.add(tracker, at(stamp))
    if isinstance(closed, Refusal):
        return closed
    return {next(iter(one.values())).stamp_ns // 10**9: sorted(one) for one in closed}


def test_stamps_are_closed_when_all_have_reported_or_at_the_end():
    gathering = Gathering(2, 100.0)
    assert add(gathering, 0, 1) == {}
    assert add(gathering, 0, 2) == {}
    assert add(gathering, 1, 2) == {1: [0], 2: [0, 1]}
    gathering = Gathering(2, math.inf)
    for stamp in (0, 1000):
        assert add(gathering, 0, stamp) == {}
    assert [sorted(one) for one in gathering.close_all()] == [[0], [0]]
    assert add(gathering, 1, 1000) is Refusal.LATE


def test_order_of_arrival_makes_no_difference():
    reports = [(0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    # Only that of one tracker's own reports is sure.
    orders = [
        order
        for order in permutations(reports)
        if all(order.index((k, 1)) < order.index((k, 2)) for k in (0, 1))
    ]
    assert len(orders) == 30
    for order in orders:
        gathering, closed = Gathering(3, 100.0), {}
        for tracker, stamp in order:
            closed |= add(gathering, tracker, stamp)
        assert closed == {1: [0, 1], 2: [0, 1, 2]}


def test_a_stamp_waits_for_a_tracker_until_the_newest_is_later_by_more_than_the_longest_delay():
    gathering = Gathering(2, 5.0)
    add(gathering, 0, 0)
    add(gathering, 1, 0)
    assert add(gathering, 0, 4) == {}
    assert add(gathering, 0, 8) == {}
    assert gathering.silent == set()
    assert add(gathering, 0, 10) == {4: [0], 8: [0], 10: [0]}
    assert gathering.silent == {1}
    assert gathering.behind_s(1) == pytest.approx(10.0)
    # From then on nothing waits for it, until it has caught up.
    assert add(gathering, 0, 12) == {12: [0]}
    assert add(gathering, 1, 11) is Refusal.LATE
    assert gathering.silent == set()
    assert add(gathering, 0, 16) == {}
    assert add(gathering, 1, 16) == {16: [0, 1]}


def test_silent_trackers_are_waited_for_by_their_period():
    gathering = Gathering(2, 5.0)
    assert add(gathering, 0, 0) == {}
    assert add(gathering, 0, 5) == {}
    assert add(gathering, 0, 6) == {0: [0], 5: [0], 6: [0]}
    gathering = Gathering(2, 5.0)
    add(gathering, 0, 0)
    add(gathering, 1, 0)
    assert add(gathering, 0, 6) == {}
    assert add(gathering, 0, 12) == {6: [0], 12: [0]}
    assert gathering.silent == {1}


@pytest.mark.parametrize("period", [1, 6, 12])
def test_trackers_with_long_periods_wait_for_each_other(period):
    gathering = Gathering(3, 5.0)
    for stamp in range(0, 10 * period, period):
        assert add(gathering, stamp % 3, stamp) == {}
        assert add(gathering, (stamp + 1) % 3, stamp) == {}
        assert gathering.silent == set()
        assert add(gathering, (stamp + 2) % 3, stamp) == {stamp: [0, 1, 2]}


def test_trackers_far_ahead_or_always_late_do_not_stop_others():
    gathering = Gathering(2, 5.0)
    add(gathering, 0, 0)
    for stamp in range(4, 40, 4):
        add(gathering, 0, stamp)
        add(gathering, 1, stamp - 8)
        if stamp >= 12:
            assert gathering.silent == {1}
    gathering = Gathering(2, 5.0)
    add(gathering, 0, 0)
    add(gathering, 1, 0)
    assert add(gathering, 0, 10**6) == {}
    assert add(gathering, 1, 4) == {4: [1]}
    assert add(gathering, 1, 8) == {8: [1]}


def test_until_when_something_may_be_on_its_way_follows_the_trackers_own_interval():
    gathering = Gathering(3, 5.0)
    for stamp in (0, 6):
        add(gathering, 0, stamp)
    add(gathering, 1, 4)
    assert gathering.expected_ns() == {0: 17e9, 1: 9e9}
    assert gathering.expected_ns(10e9) == {0: 10e9, 1: 9e9}


def test_what_comes_twice_is_refused_and_a_jump_back_is_known():
    gathering = Gathering(2, 5.0)
    add(gathering, 0, 4)
    assert add(gathering, 0, 4) is Refusal.DUPLICATE
    add(gathering, 0, 8)
    # It waits for the other one still.
    assert add(gathering, 0, 4) is Refusal.DUPLICATE
    assert gathering.jumps_back(0, 3 * 10**9)
    assert not gathering.jumps_back(1, 3 * 10**9)
    assert not gathering.jumps_back(0, 8 * 10**9)


def test_stamps_and_targets_that_wait_are_bounded():
    gathering = Gathering(2, 1e6, most_waiting=5)
    closed = [add(gathering, 0, stamp) for stamp in range(1, 21)]
    assert closed == [{}] * 5 + [{stamp: [0]} for stamp in range(1, 16)]
    assert gathering.overflow == 15
    assert add(gathering, 1, 3) is Refusal.LATE
    assert add(gathering, 1, 18) == {16: [0], 17: [0], 18: [0, 1]}
    few, many = [at(1)], [at(1), at(2)]
    crowded = of_tracks(dict.fromkeys(range(3 * TARGETS_OF_A_STAMP), (0.0, 0.0)))
    assert not too_many([{0: own} for own in many], 2)
    assert too_many([{0: own} for own in (*few, crowded)], 2)
    # One stamp may always wait, whatever its size.
    assert not too_many([{0: crowded}], 2)
    assert not too_many([{0: crowded}] * 100, None)


def estimates(stamp, tracks, speed=200.0):
    """Return estimates of tracks by number, each its x."""
    return of_tracks(
        {n: (x, 0.0) for n, x in tracks.items()}, (speed, 0.0), np.ones(5), stamp_ns=stamp * NS
    )


def followed(*said):
    """Return the unique numbers of all estimates, stamp by stamp, and the series."""
    series, found = TrackSeries(), []
    for stamp, tracks in said:
        own = None if tracks is None else estimates(stamp, tracks)
        series.take(stamp * NS, own)
        found.append([] if own is None else series.renumber(own).track_id.tolist())
    return found, series


def test_tracks_that_go_on_or_come_back_are_of_one_series():
    found, _ = followed(
        (0, {1: 0.0, 2: 9e3}), (4, {1: 800.0, 3: 50e3}), (8, {}), (12, {4: 0.0}), (16, {4: 800.0})
    )
    assert found == [[1, 2], [1, 3], [], [4], [4]]
    found, _ = followed((0, {1: 0.0, 2: 9e3}), (4, {2: 9.8e3}), (8, {1: 1.6e3, 2: 10.6e3}))
    assert found == [[1, 2], [2], [1, 2]]


def test_numbers_found_elsewhere_are_of_another_series():
    found, series = followed(
        (0, {1: 0.0, 2: 9e3}), (4, {}), (8, {1: -40e3}), (12, {1: -39e3, 2: 0.0})
    )
    assert found == [[1, 2], [], [SERIES + 1], [SERIES + 1, SERIES + 2]]
    # Smoothed estimates are distinguished by their stamp.
    assert series.renumber(estimates(0, {2: 9e3})).track_id.tolist() == [2]
    assert series.renumber(estimates(4, {1: -41e3})).track_id.tolist() == [SERIES + 1]
    found, _ = followed((0, {1: 0.0}), (4, {1: -40e3}), (8, {1: -39e3}))
    assert found == [[1], [SERIES + 1], [SERIES + 1]]


def test_single_tracks_that_leap_or_are_fast_begin_no_series():
    found, _ = followed((0, {1: 0.0, 3: 20e3, 4: 40e3}), (4, {1: 0.8e3, 2: 20.8e3, 3: 40.8e3}))
    assert found == [[1, 3, 4], [SERIES + 1, SERIES + 2, SERIES + 3]]
    found, _ = followed((0, {1: 0.0, 2: 20e3, 3: 40e3}), (4, {1: 0.8e3, 2: 20.8e3, 3: 80e3}))
    assert found == [[1, 2, 3], [1, 2, 3]]
    found, _ = followed((0, {1: 0.0}), (60, {1: 12e3}))
    assert found == [[1], [1]]


def test_series_are_kept_over_moments_and_forgotten_after_long():
    found, _ = followed((0, {1: 0.0}), (4, None), (8, {1: 1.6e3}))
    assert found == [[1], [], [1]]
    found, _ = followed((0, {1: 0.0}), (4, None), (64, None), (68, {1: 1.6e3}))
    assert found == [[1], [], [], [SERIES + 1]]
    late = round(KEPT_S) + 100
    found, series = followed((0, {1: 0.0}), (4, {}), (8, {1: -40e3}), (late, {1: -40e3}))
    assert found[-1] == [SERIES + 1]
    assert series.renumber(estimates(late, {1: 0.0})).track_id.tolist() == [SERIES + 1]
