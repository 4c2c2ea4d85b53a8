from dataclasses import replace

import numpy as np
import pytest
from estimate_sets import of_tracks

from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, UNKNOWN, Attributes
from phd_jdtc_ros.handover.picture import LATEST_STAMPS, JointPicture, Refusal

NS = 10**9
# Parted at x = 0, with an overlap of 10 km on each side.
REGIONS = (Region(-100e3, -100e3, 0.0, 100e3, 10e3), Region(0.0, -100e3, 100e3, 100e3, 10e3))
WEST, EAST = 0, 1


def estimates(stamp, tracks, lag=0):
    """Return estimates of tracks by number, each its x."""
    return of_tracks({n: (x, 0.0) for n, x in tracks.items()}, stamp_ns=stamp * NS, lag=lag)


@pytest.fixture
def picture():
    return JointPicture(REGIONS, 2e3, 8.0, 100.0)


def add(picture, source, stamp, west, east, lag=0):
    """Return what comes out: (source, stamp, joint numbers)."""
    done = []
    for tracker, tracks in ((WEST, west), (EAST, east)):
        done += picture.add(tracker, source, estimates(stamp, tracks, lag))
    return [(kind, own.stamp_ns // NS, own.track_id.tolist()) for kind, own in done]


def test_smoothed_estimates_wait_until_their_numbers_are_known(picture):
    # The filter has no track at first, the smoother has.
    assert add(picture, FILTERED, 0, {}, {}) == [(FILTERED, 0, [])]
    assert add(picture, SMOOTHED, 0, {7: -30e3}, {}, lag=3) == []
    assert add(picture, FILTERED, 4, {7: -30e3}, {}) == [(FILTERED, 4, [1])]
    done = add(picture, FILTERED, 8, {7: -30e3}, {})
    assert done == [(FILTERED, 8, [1]), (SMOOTHED, 0, [1])]


def test_what_gets_its_number_later_than_that_is_not_in_them(picture):
    add(picture, SMOOTHED, 0, {7: -30e3}, {}, lag=3)
    for stamp in (0, 4):
        add(picture, FILTERED, stamp, {}, {})
    assert add(picture, FILTERED, 12, {7: -30e3}, {}) == [(FILTERED, 12, [1]), (SMOOTHED, 0, [])]


def test_what_the_filter_has_lost_keeps_its_number(picture):
    add(picture, FILTERED, 0, {7: -30e3}, {})
    for stamp in (4, 8, 12):
        add(picture, FILTERED, stamp, {}, {})
    assert add(picture, SMOOTHED, 4, {7: -30e3}, {}, lag=3) == [(SMOOTHED, 4, [1])]


def test_joint_lag_is_that_of_the_estimates_with_a_lag(picture):
    for stamp in (0, 4, 8):
        add(picture, FILTERED, stamp, {}, {7: 30e3})
    picture.add(WEST, SMOOTHED, estimates(0, {}))
    ((_, joint),) = picture.add(EAST, SMOOTHED, estimates(0, {7: 30e3}, lag=3))
    assert (joint.lag, len(joint)) == (3, 1)


def test_a_tracker_that_reports_no_identities_leaves_those_of_the_other(picture):
    known = Attributes(
        np.array([[3048.0, 0.0]]), np.ones((1, 2, 2)), np.array([0o4521]), np.array([UNKNOWN])
    )
    picture.add(WEST, FILTERED, estimates(0, {3: -30e3}))
    east = replace(estimates(0, {7: 30e3}), attributes=known)
    ((_, joint),) = picture.add(EAST, FILTERED, east)
    assert joint.attributes.code.tolist() == [UNKNOWN, 0o4521]
    assert np.isnan(joint.attributes.height[0]).all()


def test_stamps_that_go_back_begin_a_new_run_with_new_numbers(picture):
    assert add(picture, FILTERED, 100, {7: -30e3}, {}) == [(FILTERED, 100, [1])]
    picture.add(WEST, FILTERED, estimates(104, {7: -30e3}))
    assert picture.jumps_back(WEST, FILTERED, 4 * NS)
    # The estimates that waited for the other tracker are published first.
    assert add(picture, FILTERED, 4, {7: -30e3}, {}) == [(FILTERED, 104, [1]), (FILTERED, 4, [2])]


def test_changes_from_one_tracker_to_another_are_counted(picture):
    assert picture.handed_over == 0
    for stamp, x in enumerate(np.arange(-9e3, 9e3, 1e3)):
        add(picture, FILTERED, stamp, {3: x}, {7: x + 20.0})
    assert picture.handed_over == 1


def numbered(done):
    """Return what came out: (source, stamp, joint numbers)."""
    return [(kind, own.stamp_ns // NS, own.track_id.tolist()) for kind, own in done]


def test_smoothed_stamps_that_come_again_are_late_and_begin_no_new_run(picture):
    for stamp in (100, 104, 108, 112):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
        add(picture, SMOOTHED, stamp - 4, {7: -30e3}, {5: 30e3}, lag=1)
    # A tracker after a warm start sends such stamps.
    for stamp in (96, 100, 104):
        assert not picture.jumps_back(WEST, SMOOTHED, stamp * NS)
        again = picture.add(WEST, SMOOTHED, estimates(stamp, {7: -30e3}, lag=1))
        assert again in (Refusal.LATE, Refusal.DUPLICATE)
    done = add(picture, FILTERED, 116, {7: -30e3}, {5: 30e3})
    assert done == [(FILTERED, 116, [1, 2]), (SMOOTHED, 108, [1, 2])]


def test_what_is_late_of_the_run_before_begins_no_other_run(picture):
    for stamp in (100, 104):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
    picture.add(WEST, FILTERED, estimates(108, {7: -30e3}))
    done = picture.add(WEST, FILTERED, estimates(0, {7: -30e3}))
    assert numbered(done) == [(FILTERED, 108, [1])]
    # The eastern tracker has not jumped back yet.
    for stamp in (108, 112):
        assert not picture.jumps_back(EAST, FILTERED, stamp * NS)
        assert picture.add(EAST, FILTERED, estimates(stamp, {5: 30e3})) is Refusal.LATE
    assert not picture.jumps_back(EAST, FILTERED, 0)
    done = picture.add(EAST, FILTERED, estimates(0, {5: 30e3}))
    assert numbered(done) == [(FILTERED, 0, [3, 4])]
    # Once it has, these stamps are those of the new run.
    assert add(picture, FILTERED, 108, {7: -30e3}, {5: 30e3}) == [(FILTERED, 108, [3, 4])]


def test_smoothed_estimates_of_the_run_before_have_its_numbers(picture):
    for stamp in (100, 104):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
    add(picture, SMOOTHED, 96, {7: -30e3}, {5: 30e3}, lag=1)
    assert add(picture, FILTERED, 0, {8: -30e3}, {5: 30e3})[-1] == (FILTERED, 0, [3, 4])
    # These are estimates that the trackers held back when they were reset.
    found = add(picture, SMOOTHED, 100, {7: -30e3}, {5: 30e3}, lag=1)
    assert found == [(SMOOTHED, 100, [1, 2])]
    assert numbered(picture.add(WEST, SMOOTHED, estimates(104, {7: -30e3}, lag=1))) == []
    # The new run's come after all of the run before.
    add(picture, SMOOTHED, 0, {8: -30e3}, {}, lag=1)
    for stamp in (4, 8):
        done = add(picture, FILTERED, stamp, {8: -30e3}, {5: 30e3})
    assert done[-1] == (SMOOTHED, 0, [3])


def test_smoothed_estimates_that_first_come_after_the_jump_are_of_the_run_before(picture):
    for stamp in (100, 104):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
    add(picture, FILTERED, 0, {8: -30e3}, {5: 30e3})
    found = add(picture, SMOOTHED, 100, {7: -30e3}, {5: 30e3}, lag=5)
    assert found == [(SMOOTHED, 100, [1, 2])]


def test_after_a_flush_stamps_go_on_in_a_new_run_and_none_is_published_twice(picture):
    for stamp in (100, 104):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
    add(picture, SMOOTHED, 100, {7: -30e3}, {5: 30e3}, lag=1)
    picture.add(WEST, FILTERED, estimates(108, {7: -30e3}))
    assert numbered(picture.close_all()) == [(FILTERED, 108, [1]), (SMOOTHED, 100, [1, 2])]
    assert picture.add(EAST, FILTERED, estimates(108, {5: 30e3})) is Refusal.LATE
    assert add(picture, FILTERED, 112, {7: -30e3}, {5: 30e3}) == [(FILTERED, 112, [3, 4])]
    found = add(picture, SMOOTHED, 104, {7: -30e3}, {5: 30e3}, lag=1)
    assert found == [(SMOOTHED, 104, [1, 2])]


def test_numbers_of_a_tracker_that_starts_again_are_those_of_other_targets(picture):
    for stamp in (100, 104):
        add(picture, FILTERED, stamp, {1: -30e3, 2: -60e3}, {5: 30e3})
    for stamp in (108, 112):
        done = add(picture, FILTERED, stamp, {1: -90e3}, {5: 30e3})
        assert done == [(FILTERED, stamp, [3, 4])]
    # The smoother's estimates of the time before are of the earlier targets.
    done = []
    for stamp, x in ((100, -30e3), (104, -30e3), (108, -90e3), (112, -90e3)):
        done += add(picture, SMOOTHED, stamp, {1: x}, {5: 30e3}, lag=2)
    done += add(picture, FILTERED, 120, {1: -90e3}, {5: 30e3})
    assert [own for own in done if own[0] == SMOOTHED] == [
        (SMOOTHED, 100, [1, 3]),
        (SMOOTHED, 104, [1, 3]),
        (SMOOTHED, 108, [3, 4]),
        (SMOOTHED, 112, [3, 4]),
    ]


def test_what_only_the_smoother_has_after_a_start_gets_no_earlier_targets_number(picture):
    add(picture, FILTERED, 100, {1: -30e3}, {5: 30e3})
    for stamp in range(104, 132, 4):
        add(picture, FILTERED, stamp, {}, {5: 30e3})
    # Its number comes more than 8 s later.
    add(picture, FILTERED, 132, {1: -90e3}, {5: 30e3})
    assert add(picture, SMOOTHED, 108, {1: -90e3}, {5: 30e3}, lag=6) == [(SMOOTHED, 108, [2])]


def test_targets_of_a_tracker_that_misses_a_stamp_keep_their_numbers():
    picture = JointPicture(REGIONS, 2e3, 8.0, 5.0)
    tracks = {7: -30e3, 8: -1e3}, {5: 30e3, 6: -1e3}
    for stamp in (100, 104, 108):
        assert add(picture, FILTERED, stamp, *tracks) == [(FILTERED, stamp, [1, 2, 3])]
    # The eastern one is too late for some stamps.
    for stamp in (112, 116, 120):
        picture.add(WEST, FILTERED, estimates(stamp, tracks[WEST]))
    assert picture.add(EAST, FILTERED, estimates(120, tracks[EAST])) is Refusal.LATE
    picture.add(EAST, FILTERED, estimates(124, tracks[EAST]))
    done = picture.add(WEST, FILTERED, estimates(124, tracks[WEST]))
    assert numbered(done) == [(FILTERED, 124, [1, 2, 3])]


def test_stamps_that_are_never_common_are_counted():
    picture = JointPicture(REGIONS, 2e3, 8.0, 5.0)
    for stamp in range(100, 160, 6):
        add(picture, FILTERED, stamp, {7: -30e3}, {5: 30e3})
    assert picture.uncommon_stamps == 0
    for stamp in range(160, 220, 6):
        picture.add(WEST, FILTERED, estimates(stamp, {7: -30e3}))
        picture.add(EAST, FILTERED, estimates(stamp + 2, {5: 30e3}))
    assert picture.uncommon_stamps == LATEST_STAMPS
    # A tracker that is silent is no reason.
    for stamp in range(400, 460, 6):
        picture.add(WEST, FILTERED, estimates(stamp, {7: -30e3}))
    assert picture.silent == {EAST}
    assert picture.uncommon_stamps == 0


def test_smoothed_estimates_that_wait_for_the_filtered_picture_are_bounded():
    picture = JointPicture(REGIONS, 2e3, 8.0, 100.0, most_waiting=5)
    found = [add(picture, SMOOTHED, stamp, {}, {}) for stamp in range(1, 11)]
    assert found == [[]] * 5 + [[(SMOOTHED, stamp, [])] for stamp in range(1, 6)]


def test_stamps_that_went_out_early_are_counted_over_runs():
    picture = JointPicture(REGIONS, 2e3, 8.0, 1e6, most_waiting=3)
    for stamp in range(1, 11):
        picture.add(WEST, FILTERED, estimates(stamp, {}))
    assert picture.overflow == 7
    picture.close_all()
    assert picture.overflow == 7
