"""Aircraft that return have their numbers again, and one address has one track."""

from dataclasses import replace

import estimate_sets
import numpy as np
import pytest
from hard_turns import PERIOD_S, scenes, seen, tracker
from runs import stepped, stored_and_read

from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.tracks import track_numbers
from phd_jdtc_ros.core.tracks.track_numbers import (
    FEW_NUMBERS,
    MARGIN,
    KnownAircraft,
    LastSeen,
    Reach,
    TrackNumbers,
)
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, UNKNOWN, Attributes
from phd_jdtc_ros.evaluation.comparison import LabelledPoints
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches

REACH = Reach(kept_s=600.0, speed=300.0)
SECOND = 10**9
EXACT = np.array([5.0, np.radians(0.01)])
CUTOFF = 1000.0


def estimates(seconds, *targets):
    """Return estimates of targets (label, address, x, state)."""
    label, address, x, state = (np.array(column) for column in zip(*targets, strict=True))
    count = len(label)
    unknown = np.full(count, UNKNOWN)
    height = np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan)
    return estimate_sets.estimates(
        estimate_sets.states(np.column_stack([x, 0.0 * x])),
        weight=0.9,
        stamp_ns=seconds * SECOND,
        track_id=label,
        track_state=state,
        attributes=Attributes(*height, unknown, address),
    )


def numbers(tracks, seconds, *targets):
    return tracks.assign(estimates(seconds, *targets), REACH).track_id.tolist()


def test_addresses_bring_their_numbers_back_to_their_aircraft():
    tracks = TrackNumbers()
    assert numbers(tracks, 0, (5, 77, 0.0, CONFIRMED), (6, 78, 5e4, CONFIRMED)) == [1, 2]
    tracks.forget_all_but([np.zeros(0, dtype=np.int64)])
    assert numbers(tracks, 100, (30, 78, 6e4, CONFIRMED), (31, 77, 2e4, CONFIRMED)) == [2, 1]
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED))
    assert numbers(tracks, 20, (5, 77, 4e3, COASTING), (40, 77, -3e3, CONFIRMED)) == [1]
    assert numbers(tracks, 24, (5, 77, 5e3, CONFIRMED), (40, 77, -3e3, CONFIRMED)) == [1, 2]


def test_numbers_of_ended_targets_are_dropped_before_they_are_many():
    tracks = TrackNumbers()
    for label in range(1, 3 * FEW_NUMBERS):
        assert numbers(
            tracks, 0, (1, UNKNOWN, 0.0, CONFIRMED), (label + 1, UNKNOWN, 9e4, CONFIRMED)
        )
        tracks.forget_all_but([np.array([0, label])])
    assert len(tracks.in_use) < FEW_NUMBERS + 10
    assert tracks.in_use[1] == 1


@pytest.mark.parametrize(
    ("seconds", "place"), [(10, MARGIN + 3001.0), (601, 0.0)], ids=["too far", "too late"]
)
def test_address_out_of_reach_is_of_another_aircraft(seconds, place):
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED))
    assert numbers(tracks, seconds, (30, 77, place, CONFIRMED)) == [2]


def test_only_an_address_gives_a_number_again():
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, UNKNOWN, 0.0, CONFIRMED))
    assert numbers(tracks, 4, (30, UNKNOWN, 0.0, CONFIRMED)) == [2]
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED))
    numbers(tracks, 10, (5, 77, 9e4, COASTING))
    assert tracks.aircraft.seen == {1: LastSeen(77, 0, (0.0, 0.0), 0.0)}


def test_tracks_with_one_number_and_two_addresses_are_two_aircraft():
    tracks = TrackNumbers()
    assert numbers(tracks, 0, (5, 77, 0.0, CONFIRMED), (6, 78, 800.0, CONFIRMED)) == [1, 2]
    tracks.forget_all_but([np.zeros(0, dtype=np.int64)])
    # A track begins at a reflected reply of 77, and is then seen to be 78, which had ended.
    assert numbers(tracks, 4, (5, 77, 0.0, COASTING), (30, 77, 900.0, CONFIRMED)) == [1]
    assert numbers(tracks, 8, (5, 77, 0.0, CONFIRMED), (30, 78, 800.0, CONFIRMED)) == [1, 2]
    # Without a number of its own it gets a new one.
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED))
    numbers(tracks, 4, (5, 77, 0.0, COASTING), (30, 77, 900.0, CONFIRMED))
    assert numbers(tracks, 8, (5, 77, 0.0, CONFIRMED), (30, 78, 800.0, CONFIRMED)) == [1, 2]


def test_two_tracks_that_one_radar_detects_apart_are_two():
    def found(tracks, seconds, reach, place=300.0, state=CONFIRMED):
        two = estimates(seconds, (5, 77, 0.0, CONFIRMED), (6, 77, place, state))
        return tracks.assign(two, reach).track_id.tolist()

    one, several = replace(REACH, look_s=4.0), REACH
    tracks = TrackNumbers()
    assert [found(tracks, 4 * look, one) for look in range(3)] == [[1], [1], [1, 2]]
    # They are two also after a restart, and where one is not detected.
    snapshot = Snapshot(8 * SECOND)
    tracks.to_snapshot(snapshot)
    restored = TrackNumbers.from_snapshot(stored_and_read(snapshot))
    for again in (tracks, restored):
        assert found(again, 12, one, state=COASTING) == [1, 2]
    # Estimates of one look do not count twice, nor do those of one place, or of several radars.
    tracks = TrackNumbers()
    assert {*map(tuple, (found(tracks, k, one) for k in range(8)))} == {(1,)}
    tracks = TrackNumbers()
    assert {*map(tuple, (found(tracks, 4 * k, one, 3.0) for k in range(8)))} == {(1,)}
    tracks = TrackNumbers()
    assert {*map(tuple, (found(tracks, 4 * k, several) for k in range(8)))} == {(1,)}


def test_of_two_tracks_of_one_aircraft_the_one_that_was_reported_stays():
    tracks, reported = TrackNumbers(), []
    for look in range(6):
        two = estimates(4 * look, (5, 77, 0.0, CONFIRMED), (6, 77, 300.0, CONFIRMED))
        better = np.where(np.arange(2) == look % 2, 0.9, 0.91)
        reported += tracks.assign(two.changed(weight=better), REACH).position[:, 0].tolist()
    assert len({*reported}) == 1


def test_two_tracks_of_one_address_are_one_and_two_aircraft_two():
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED), (6, UNKNOWN, 20.0, CONFIRMED))
    found = tracks.assign(estimates(4, (5, 77, 0.0, COASTING), (6, 77, 20.0, CONFIRMED)), REACH)
    assert found.track_id.tolist() == [1]
    assert found.position[0, 0] == 20.0
    assert numbers(tracks, 8, (6, 77, 40.0, CONFIRMED)) == [1]
    tracks = TrackNumbers()
    for seconds in range(0, 40, 4):
        both = (5, 77, 0.0, CONFIRMED), (6, 77, 2e3, CONFIRMED)
        assert numbers(tracks, seconds, *both) == [1, 2]


def test_track_that_coasts_elsewhere_is_not_reported_beside_its_aircraft():
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 0.0, CONFIRMED))
    numbers(tracks, 20, (5, 77, 4e3, COASTING))
    found = tracks.assign(estimates(24, (5, 77, 5e3, COASTING), (40, 77, -3e3, CONFIRMED)), REACH)
    assert (found.track_id.tolist(), found.position[0, 0]) == ([1], -3e3)


def test_aircraft_are_forgotten_after_their_time_and_beyond_the_most(monkeypatch):
    monkeypatch.setattr(track_numbers, "MAX_AIRCRAFT", 3)
    tracks = TrackNumbers()
    for index in range(5):
        numbers(tracks, index, (10 + index, 100 + index, 1e4 * index, CONFIRMED))
    assert list(tracks.aircraft.seen) == [3, 4, 5]
    numbers(tracks, 604, (50, 300, 0.0, CONFIRMED))
    assert list(tracks.aircraft.seen) == [5, 6]


def test_stored_aircraft_are_the_same():
    tracks = TrackNumbers()
    numbers(tracks, 0, (5, 77, 12.5, CONFIRMED), (6, 78, 5e4, CONFIRMED))
    snapshot = Snapshot(0)
    tracks.to_snapshot(snapshot)
    again = TrackNumbers.from_snapshot(stored_and_read(snapshot)).aircraft
    assert again == tracks.aircraft
    assert again.number_of(78, (5e4, 0.0), 0, REACH) == 2


def test_aircraft_of_numbers_that_were_never_given_are_refused():
    snapshot = Snapshot(0)
    KnownAircraft({1: LastSeen(77, 0, (0.0, 0.0), 0.0)}).to_snapshot(snapshot)
    snapshot.arrays["aircraft.number"] = np.array([9])
    with pytest.raises(ValueError, match="1 aircraft with numbers up to 9, expected at most 10000"):
        KnownAircraft.from_snapshot(snapshot, 2)


def crossing(hidden, address=77, seed=21, scans=40):
    """Return scans of an aircraft that is out of sight for some of them, and turns meanwhile."""
    rng = np.random.default_rng(seed)
    position, found = np.array([[-2e4, 3e4]]), []
    for index in range(scans):
        velocity = np.array([150.0, 0.0]) if index < min(hidden) + 3 else np.array([0.0, -150.0])
        position = position + PERIOD_S * velocity
        place = position if index not in hidden else position[:0]
        found.append(
            seen(place, np.full(len(place), address), rng, (index + 1) * PERIOD_S, noise=EXACT)
        )
    return found


def test_aircraft_out_of_sight_for_a_minute_has_its_number_again():
    one, given, smoothed = tracker(), [], set()
    for step in map(one.step, crossing(range(12, 27))):
        given += [set(found.track_id.tolist()) for found in step.filtered]
        smoothed |= {number for found in step.smoothed for number in found.track_id.tolist()}
    assert set() in given[14:27]
    assert set.union(*given) == smoothed == {1}
    assert given[-1] == {1}


def test_restored_engine_remembers_aircraft_that_are_out_of_sight():
    scans = crossing(range(12, 27))
    one, other = tracker(), tracker()
    stepped(one, scans[:24])
    other.restore(stored_and_read(one.snapshot()))
    assert stepped(other, scans[24:])[0][-1].track_id.tolist() == [1]


def test_gap_of_the_input_leaves_aircraft_their_numbers():
    scans = crossing(range(12, 27))
    one = tracker()
    stepped(one, scans[:12])
    one.interrupt()
    assert stepped(one, scans[27:])[0][-1].track_id.tolist() == [1]


def answered(estimates):
    return estimates.attributes.address[estimates.attributes.address != UNKNOWN]


def switches_of(steps, truth):
    counted, label = IdentitySwitches(CUTOFF), np.arange(1, truth.shape[1] + 1)
    return sum(
        counted.add(LabelledPoints(label, position), LabelledPoints(found.track_id, found.position))
        for position, step in zip(truth, steps, strict=True)
        for found in step.filtered
    )


def test_aircraft_that_leave_their_gates_have_one_track_each():
    _, scans = scenes(11, 40)
    one = tracker()
    for step in map(one.step, scans):
        for found in (*step.filtered, *step.smoothed):
            assert len(set(answered(found).tolist())) == len(answered(found))


def test_addresses_make_no_more_switches_than_none():
    with_addresses, without = (
        switches_of(map(tracker(addresses).step, scans), truth)
        for addresses in (True, False)
        for truth, scans in [scenes(12, 40, addresses)]
    )
    assert with_addresses <= 0.1 * without


def test_two_aircraft_with_one_address_far_apart_both_live():
    rng = np.random.default_rng(13)
    one, found = tracker(), []
    velocity = np.array([[150.0, 20.0], [-120.0, 60.0]])
    for index in range(20):
        position = [[-3e4, 1e4], [2e4, -2e4]] + velocity * PERIOD_S * index
        exact = np.array([5.0, np.radians(0.01)])
        scan = seen(position, np.array([77, 77]), rng, (index + 1) * PERIOD_S, noise=exact)
        found += one.step(scan).filtered
        if index >= 8:
            apart = np.hypot(*(position[:, None] - found[-1].position[None]).T)
            assert apart.min(axis=0).max() < 500.0, index
    numbers = [set(estimates.track_id[estimates.attributes.address == 77]) for estimates in found]
    assert set.union(*numbers[8:]) == set(numbers[8])
    assert len(numbers[8]) == 2
