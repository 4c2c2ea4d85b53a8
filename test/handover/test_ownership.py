import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from estimate_sets import of_tracks
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csgraph

from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.tracks.renumbering import GATE, match
from phd_jdtc_ros.core.types import UNKNOWN, Attributes
from phd_jdtc_ros.core.types.reports import Reported
from phd_jdtc_ros.handover import ownership
from phd_jdtc_ros.handover.ownership import APART, FORGOTTEN_S, TOGETHER, Handover, Numbers

# Parted at x = 0, with an overlap of 10 km on each side.
REGIONS = (Region(-100e3, -100e3, 0.0, 100e3, 10e3), Region(0.0, -100e3, 100e3, 100e3, 10e3))
HYSTERESIS = 2e3


def estimates(stamp, tracks, std=50.0):
    """Return estimates of tracks by number, each (x, y)."""
    variance = (std**2, 1.0, std**2, 1.0, 1e-6)
    return of_tracks(tracks, variance=variance, stamp_ns=stamp * 10**9)


def joined(handover, stamp, west, east):
    """Return the joint tracks of a stamp: x by number."""
    found = handover.add(dict(enumerate([estimates(stamp, west), estimates(stamp, east)])))
    assert found.stamp_ns == stamp * 10**9
    return dict(zip(found.track_id.tolist(), found.position[:, 0].tolist(), strict=True))


def crossing(first, last, step, handover, east_number=7, offset=30.0, y=0.0):
    """Return what is reported while a target flies from one x to another; both may see it."""
    seen = []
    for stamp, x in enumerate(np.arange(first, last, step)):
        west = {3: (x, y)} if x < 10e3 else {}
        east = {east_number: (x + offset, y)} if x > -8e3 else {}
        seen.append(joined(handover, stamp, west, east))
    return seen


def test_what_crosses_the_seam_changes_over_once_behind_the_hysteresis():
    seen = crossing(-15e3, 20e3, 1e3, Handover(REGIONS, HYSTERESIS))
    assert [list(tracks) for tracks in seen] == [[1]] * len(seen)
    seen = crossing(-15e3, 20e3, 1e3, Handover(REGIONS, HYSTERESIS))
    x = np.arange(-15e3, 20e3, 1e3)
    of_east = [tracks[1] != place for tracks, place in zip(seen, x, strict=True)]
    assert x[of_east.index(True)] == HYSTERESIS
    assert all(of_east[of_east.index(True) :])
    handover, owners = Handover(REGIONS, HYSTERESIS), set()
    for stamp in range(20):
        x = 1e3 * (-1) ** stamp
        tracks = joined(handover, stamp, {3: (x, 0.0)}, {7: (x + 30.0, 0.0)})
        assert list(tracks) == [1]
        owners.add(tracks[1] == x)
    assert len(owners) == 1


def test_a_joint_track_names_its_owner_and_its_number_in_each_tracker():
    handover = Handover(REGIONS, HYSTERESIS)
    for stamp in range(TOGETHER + 1):
        both = estimates(stamp, {3: (500.0, 0.0)}), estimates(stamp, {7: (520.0, 0.0), 9: (9e4, 0)})
        found = handover.add(dict(enumerate(both)))
    assert dict(zip(found.track_id.tolist(), found.members.tolist(), strict=True)) == {
        1: [1, 3, 7],
        2: [1, 0, 9],
    }
    again = handover.join_numbered(dict(enumerate(both)), handover.numbers)
    assert again.members.tolist() == found.members.tolist()


def test_what_self_reports_say_stays_with_its_target():
    both = [estimates(0, {3: (-9e4, 0.0)}), estimates(0, {7: (9e4, 0.0)})]
    told = [
        replace(each, reports=replace(Reported.unknown(1), dark=np.array([dark])))
        for each, dark in zip(both, (0.2, 0.7), strict=True)
    ]
    found = Handover(REGIONS, HYSTERESIS).add(dict(enumerate(told)))
    assert found.reports.dark.tolist() == [0.2, 0.7]
    # One tracker without a receiver leaves nothing to say.
    found = Handover(REGIONS, HYSTERESIS).add({0: both[0], 1: told[1]})
    assert (len(found), found.reports) == (2, None)


def test_two_targets_near_each_other_keep_their_numbers():
    handover = Handover(REGIONS, HYSTERESIS)
    numbers = []
    for stamp, x in enumerate(np.arange(-12e3, 14e3, 1e3)):
        west = {3: (x, 0.0), 4: (x, 400.0)} if x < 10e3 else {}
        east = {8: (x + 30.0, 400.0), 9: (x - 30.0, 0.0)} if x > -8e3 else {}
        found = handover.add(dict(enumerate([estimates(stamp, west), estimates(stamp, east)])))
        order = np.argsort(found.position[:, 1])
        numbers.append(found.track_id[order].tolist())
    assert numbers == [[1, 2]] * len(numbers)


def test_two_targets_stay_two_where_one_tracker_switches_their_identities():
    handover = Handover(REGIONS, HYSTERESIS)
    near, far = (-1e3, 0.0), (-1e3, 400.0)
    for stamp in range(4):
        joined(handover, stamp, {3: near, 4: far}, {8: near, 9: far})
    for stamp in range(4, 4 + TOGETHER + APART + 1):
        found = handover.add(
            {0: estimates(stamp, {3: near, 4: far}), 1: estimates(stamp, {8: far, 9: near})}
        )
        order = np.argsort(found.position[:, 1])
        assert found.track_id[order].tolist() == [1, 2]
    assert handover.numbers == {(0, 3): 1, (0, 4): 2, (1, 8): 2, (1, 9): 1}


def test_a_target_is_not_lost_to_the_neighbours_track_that_leaves_it():
    handover = Handover(REGIONS, HYSTERESIS)
    west = {3: (-1e3, 0.0), 4: (-1e3, 400.0)}
    for stamp in range(4):
        joined(handover, stamp, west, {8: (-1e3, 0.0)})
    # The eastern tracker's track goes over to the other target.
    for stamp in range(4, 4 + TOGETHER + APART + 1):
        tracks = joined(handover, stamp, west, {8: (-1e3, 400.0)})
        assert list(tracks) == [1, 2]


def test_what_only_one_has_is_reported_once_it_has_a_number():
    handover = Handover(REGIONS, HYSTERESIS)
    # A new track in the margin of the western tracker: its place is the eastern one's.
    assert joined(handover, 0, {3: (4e3, 0.0)}, {}) == {}
    assert list(joined(handover, 1, {3: (4e3, 0.0)}, {7: (4e3, 0.0)})) == [1]
    handover = Handover(REGIONS, HYSTERESIS)
    for stamp in range(TOGETHER):
        joined(handover, stamp, {3: (-1e3, 0.0)}, {7: (-1e3, 0.0)})
    assert list(joined(handover, 5, {}, {7: (-500.0, 0.0)})) == [1]


def test_tracks_that_part_are_two_targets_again():
    handover = Handover(REGIONS, HYSTERESIS)
    for stamp in range(4):
        assert list(joined(handover, stamp, {3: (-1e3, 0.0)}, {7: (-1e3, 0.0)})) == [1]
    for stamp in range(4, 4 + APART + 1):
        away = 2e3 * (stamp - 3)
        tracks = joined(handover, stamp, {3: (-1e3, 0.0)}, {7: (-1e3, away)})
    # The eastern one is in the western region, whose tracker does not have it.
    assert list(tracks) == [1]
    tracks = joined(handover, 20, {3: (-1e3, 0.0)}, {7: (500.0, 9e3)})
    assert tracks == {1: -1e3, 2: 500.0}


def test_heights_and_identities_stay_with_their_targets():
    def coded(found, code):
        count = len(found)
        known = Attributes(
            np.full((count, 2), float(code)),
            np.zeros((count, 2, 2)),
            np.full(count, code),
            np.full(count, UNKNOWN),
        )
        return replace(found, attributes=known)

    west, east = estimates(0, {3: (-50e3, 0.0)}), estimates(0, {7: (50e3, 0.0), 8: (60e3, 0.0)})
    found = Handover(REGIONS, HYSTERESIS).add(dict(enumerate([coded(west, 11), coded(east, 22)])))
    order = np.argsort(found.position[:, 0])
    assert found.attributes.code[order].tolist() == [11, 22, 22]
    assert found.attributes.height[order, 0].tolist() == [11.0, 22.0, 22.0]


def test_numbers_of_ended_tracks_are_not_used_again_and_forgotten():
    handover = Handover(REGIONS, HYSTERESIS)
    assert list(joined(handover, 0, {3: (-50e3, 0.0)}, {})) == [1]
    assert joined(handover, 1, {}, {}) == {}
    assert list(joined(handover, 2, {4: (-50e3, 0.0)}, {})) == [2]
    numbers = Numbers(0)
    numbers.add(0, {(WEST, 3): 1})
    assert numbers.at(0) == {(WEST, 3): 1}
    numbers.add(round(FORGOTTEN_S + 1.0) * NS, {})
    assert numbers.at(0) == {}


@pytest.mark.parametrize("spread", [9e3, 300.0, 0.0])
def test_thousands_of_targets_at_the_seam_are_joined_in_bounded_time_and_memory(spread):
    rng = np.random.default_rng(6)
    count = 3000
    place = rng.uniform(-spread, spread, (count, 2))
    handover = Handover(REGIONS, HYSTERESIS)
    longest_s = 0.0
    tracemalloc.start()
    for stamp in range(TOGETHER):
        seen = [dict(enumerate(place + 20.0 * rng.standard_normal(place.shape))) for _ in REGIONS]
        both = [estimates(stamp, {n + 1: own for n, own in said.items()}) for said in seen]
        begin_s = time.process_time()
        found = handover.add(dict(enumerate(both)))
        longest_s = max(longest_s, time.process_time() - begin_s)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count <= len(found) <= 2 * count
    assert peak < 256e6
    # It is three times as slow under tracemalloc; comparing all pairs takes 13 s and 4.5 GB.
    assert longest_s < 3.0


def test_covariances_so_wide_that_rounding_makes_them_singular_are_compared():
    wide = estimates(0, {3: (0.0, 0.0)})
    covariance = wide.covariance.copy()
    covariance[0, ::2, ::2] = 1e30
    wide = replace(wide, covariance=covariance)
    rows, columns = match(wide, wide, moving=True)
    assert (rows.tolist(), columns.tolist()) == ([0], [0])


def test_matched_pairs_are_those_of_least_total_distance():
    rng = np.random.default_rng(7)
    for _ in range(50):
        one, other = (
            estimates(0, dict(enumerate(rng.uniform(0.0, 500.0, (count, 2)), 1)))
            for count in rng.integers(1, 25, 2)
        )
        rows, columns = match(one, other)
        apart = one.position[:, None] - other.position[None]
        cost = (apart**2).sum(axis=2) / (2.0 * 50.0**2 + 1.0)
        limited = np.where(cost <= GATE, cost, 1e6)
        best = limited[linear_sum_assignment(limited)]
        assert len(rows) == np.count_nonzero(best < 1e6)
        assert_allclose(cost[rows, columns].sum(), best[best < 1e6].sum(), rtol=1e-4)


def test_tracks_are_matched_by_scipy_before_1_15(monkeypatch):
    solve = csgraph.min_weight_full_bipartite_matching

    def earlier(edges):
        # It refuses indices of eight bytes.
        assert {edges.indices.dtype, edges.indptr.dtype} == {np.dtype(np.int32)}
        return solve(edges)

    monkeypatch.setattr(csgraph, solve.__name__, earlier)
    found = estimates(0, {3: (0.0, 0.0), 5: (9e3, 0.0)})
    rows, columns = match(found, found)
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [0, 1])


NS = 10**9
WEST = 0


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
    monkeypatch.setattr(ownership, "MOST_TRACKS", 10)
    numbers = Numbers(0)
    for stamp in range(20):
        numbers.add(stamp, {(0, stamp): stamp})
    assert numbers.at(19) == {(0, stamp): stamp for stamp in range(10, 20)}
