# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.core.joint_picture import FORGOTTEN_S, JointPicture, Numbers
from phd_jdtc_ros.core.region import Region
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, UNKNOWN, Attributes, Estimates

NS = 10**9
# Parted at x = 0, with an overlap of 10 km on each side.
REGIONS = (
    Region(-100e3, -100e3, 0.0, 100e3, 10e3),
    Region(0.0, -100e3, 100e3, 100e3, 10e3),
)
WEST, EAST = 0, 1


def estimates(stamp, tracks, lag=0):
    """Return estimates of tracks by number, each its x."""
    count = len(tracks)
    state = np.zeros((count, 5))
    state[:, 0] = list(tracks.values())
    return Estimates(
        stamp_ns=stamp * NS,
        lag=lag,
        state=state,
        covariance=np.tile(np.diag([2500.0, 1.0, 2500.0, 1.0, 1e-6]), (count, 1, 1)),
        weight=np.ones(count),
        class_probability=np.ones((count, 1)),
        class_id=np.zeros(count, dtype=int),
        track_id=np.array(list(tracks), dtype=int),
    )


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


def test_joint_lag_is_that_of_the_estimates_that_tell_it(picture):
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
    # What waited for the other one is published first.
    assert add(picture, FILTERED, 4, {7: -30e3}, {}) == [(FILTERED, 104, [1]), (FILTERED, 4, [2])]


def test_changes_from_one_tracker_to_another_are_counted(picture):
    assert picture.handed_over == 0
    for stamp, x in enumerate(np.arange(-9e3, 9e3, 1e3)):
        add(picture, FILTERED, stamp, {3: x}, {7: x + 20.0})
    assert picture.handed_over == 1


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
