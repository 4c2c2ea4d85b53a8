"""The rules for what is used of a transmitter, and the times of its positions."""

from collections import Counter

import pytest

from phd_jdtc_ros.transponders.messages import AIS, ICAO, MMSI, NONE, TRACK_NUMBER, Heard
from phd_jdtc_ros.transponders.transmitters import MOST, Transmitters

S = 10**9
NOW = 1_700_000_000 * S  # 20 s after a minute
MINUTE = 60 * S


def rules(**more):
    return Transmitters(Counter(), 10 * S, **more)


def ship(address=211000001, second=20, **more):
    """Return a position of a ship at a second of its minute; -1 for none."""
    own_ns = NONE if second < 0 else second * S + S // 2
    given = {"latitude": 54.5, "longitude": 10.25, "network": AIS, "period_ns": MINUTE, **more}
    return Heard(MMSI, address, own_ns, **given)


def aircraft(address=0x40621D, **more):
    return Heard(ICAO, address, **{"latitude": 50.0, "longitude": 8.0, **more})


def test_the_second_is_of_the_minute_nearest_to_the_receipt():
    found = rules()
    assert found.take(ship(second=20), NOW + S).time_ns == NOW + S // 2
    assert found.take(ship(second=59, latitude=1.0), NOW + 41 * S).time_ns == NOW + 39 * S + S // 2
    # The receiver's clock is in the next minute already.
    assert found.take(ship(2, second=59), NOW + 40 * S).time_ns == NOW + 39 * S + S // 2
    assert found.counts == {}


def test_without_a_second_the_receipt_counts():
    found = rules()
    assert found.take(ship(second=-1), NOW).time_ns == NOW
    assert found.counts == {"no_time": 1}


def test_times_far_from_the_receipt_are_not_used():
    found = rules()
    assert found.take(ship(second=50), NOW).time_ns == NOW
    assert found.counts == {"time_off": 1}


def test_a_clock_that_stands_is_not_used():
    found = rules()
    for passed in (0, 4, 8):
        dated = found.take(ship(second=20, longitude=10.0 + passed), NOW + passed * S)
        assert dated.time_ns == (NOW + passed * S if passed else NOW + S // 2)
    assert found.counts == {"time_stands": 2}


def test_a_ship_at_anchor_reports_at_the_same_second_of_every_third_minute():
    found = rules()
    for passed in range(0, 1800, 180):
        dated = found.take(ship(second=20), NOW + passed * S)
        assert dated.time_ns == NOW + passed * S + S // 2
    assert found.counts == {}


def test_a_recording_without_receipts_goes_on_from_its_start():
    found = rules(start_ns=NOW)
    seconds = [*range(20, 60, 10), *range(0, 60, 10), 0, 15]
    times = [
        found.take(ship(second=second, longitude=float(k)), None).time_ns
        for k, second in enumerate(seconds)
    ]
    assert [(time - NOW) // S for time in times] == [*range(0, 101, 10), 115]


def test_a_recording_of_1970_has_no_negative_times():
    assert rules().take(ship(second=50), None).time_ns == 50 * S + S // 2


def test_base_stations_date_a_recording_without_receipts():
    found = rules()
    assert found.take(Heard(MMSI, 2111234, NOW, network=AIS, clock=True), None) is None
    # A single one may be wrong.
    assert found.take(ship(second=30), None).time_ns < 10**12
    found.take(Heard(MMSI, 2111234, NOW + 9 * S, network=AIS, clock=True), None)
    assert found.take(ship(second=30), None).time_ns == NOW + 10 * S + S // 2


@pytest.mark.parametrize("zone_s", [-12 * 3600, -900, 0, 5 * 3600 + 45 * 60])
def test_times_of_a_zone_are_of_the_quarter_nearest_to_the_receipt(zone_s):
    found = rules()
    heard = aircraft(own_ns=NOW + zone_s * S, period_ns=900 * S)
    assert found.take(heard, NOW + S).time_ns == NOW
    assert rules().take(heard, None).time_ns == NOW + zone_s * S


def test_times_that_fit_no_stamp_are_left_out():
    found = rules()
    assert found.take(aircraft(own_ns=2**62, period_ns=900 * S), None) is None
    assert found.counts == {"time_impossible": 1}


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(91, 10), (54, 181), (91, 181), (54, float("nan"))]
)
def test_positions_that_are_not_available_are_left_out(latitude, longitude):
    found = rules()
    place = {"latitude": float(latitude), "longitude": float(longitude)}
    assert found.take(ship(**place), NOW) is None
    assert found.counts == {"no_position": 1}


@pytest.mark.parametrize(
    "heard",
    [ship(0), ship(10**9), aircraft(0), aircraft(2**24 - 1), aircraft(2**24), aircraft(NONE)],
)
def test_addresses_that_cannot_be_are_left_out(heard):
    found = rules()
    assert found.take(heard, NOW) is None
    assert found.counts == {"no_address": 1}


def test_the_own_ship_is_no_target_whoever_heard_her():
    found = rules()
    assert found.take(ship(5, own_ship=True), NOW) is None
    assert found.take(ship(5), NOW) is None
    assert found.take(ship(6), NOW)
    assert found.counts == {"own_ship": 2}


def test_a_name_a_type_and_dimensions_count_when_heard_twice():
    found = rules()
    for passed, (name, known) in enumerate(
        [
            ("ANNA", ""),
            ("ANNA", "ANNA"),
            ("BNNA", "ANNA"),
            ("ANNA", "ANNA"),
            ("CORA", "ANNA"),
            ("CORA", "CORA"),
        ]
    ):
        own = ship(
            name=name, type=70, hull=(1, 2, 3, 4), latitude=50.0 + passed, second=20 + passed
        )
        heard = found.take(own, NOW + passed * S).heard
        assert heard.name == known
        assert heard.type == (70 if passed else 0)
        assert heard.hull == ((1, 2, 3, 4) if passed else None)


def test_names_of_other_messages_go_with_the_positions():
    found = rules()
    for _ in range(2):
        assert found.take(Heard(MMSI, 7, name="ANNA", type=36, network=AIS), NOW) is None
    heard = found.take(ship(7), NOW).heard
    assert (heard.name, heard.type) == ("ANNA", 36)
    assert found.counts == {"names": 2}


def test_velocities_and_heights_go_with_positions_for_a_while():
    found = rules()
    found.take(Heard(ICAO, 0x40621D, speed=100.0, course=90.0), NOW)
    heard = found.take(aircraft(height=1000.0), NOW + 2 * S).heard
    assert (heard.speed, heard.course, heard.height) == (100.0, 90.0, 1000.0)
    late = found.take(aircraft(latitude=51.0), NOW + 9 * S).heard
    assert late.speed != late.speed


def test_coarse_positions_of_ships_with_others_are_left_out():
    found = rules()
    assert found.take(ship(8, second=-1, long_range=True), NOW)
    assert found.take(ship(9), NOW)
    assert found.take(ship(9, second=-1, long_range=True), NOW + 100 * S) is None
    assert found.take(ship(9, second=-1, long_range=True), NOW + 700 * S)
    assert found.counts["coarse"] == 1


def test_the_same_message_of_a_second_receiver_is_left_out():
    found = rules()
    assert found.take(ship(), NOW)
    assert found.take(ship(), NOW + S) is None
    assert found.take(ship(second=22), NOW + 2 * S)
    assert found.take(aircraft(), NOW)
    assert found.take(aircraft(), NOW + S // 10) is None
    assert found.take(aircraft(), NOW + S)
    assert found.counts == {"repeated": 2}


@pytest.mark.parametrize("every_s", [2, 10])
def test_a_moving_ship_of_a_second_receiver_that_is_seconds_late_is_left_out(every_s):
    found, came = rules(), []
    for count in range(6):
        passed = 20 + count * every_s
        report = ship(second=passed % 60, latitude=54.5 + 1e-3 * count, speed=8.0)
        for late_s in (1, 5):
            came.append((NOW + (passed - 20 + late_s) * S, report))
    dated = [found.take(report, now_ns) for now_ns, report in sorted(came, key=lambda own: own[0])]
    times = [each.time_ns for each in dated if each]
    assert times == [NOW + S // 2 + count * every_s * S for count in range(6)]
    assert found.counts == {"repeated": 6}


def test_a_receiver_whose_positions_stand_is_heard():
    found = rules()
    heard = [found.take(ship(speed=8.0), NOW + count * 10 * S) for count in range(6)]
    assert all(heard)
    assert found.counts == {"time_stands": 5}


def test_an_address_that_differs_by_one_bit_must_be_heard_twice():
    found = rules()
    for number in range(20):
        found.take(aircraft(latitude=50.0 + number * 1e-3), NOW + number * S)
    near, far = aircraft(0x40621D ^ 1 << 17), aircraft(0x40621D ^ 3)
    assert found.take(near, NOW + 20 * S) is None
    assert found.take(far, NOW + 20 * S)
    assert found.take(near._replace(latitude=51.0), NOW + 21 * S)
    assert found.counts == {"one_bit": 1}


def test_neighbours_of_an_address_that_was_heard_long_ago_or_seldom_are_used():
    found = rules()
    for number in range(19):
        found.take(aircraft(latitude=50.0 + number * 1e-3), NOW + number * S)
    assert found.take(aircraft(0x40621D ^ 1), NOW + 20 * S)
    found.take(aircraft(latitude=60.0), NOW + 21 * S)
    assert found.take(aircraft(0x40621D ^ 2), NOW + 100 * S)


def test_ten_thousand_reports_of_one_address_in_a_second_are_ten():
    found = rules()
    used = [
        found.take(ship(latitude=k * 1e-3), NOW + k * S // 10_000) is not None
        for k in range(10_000)
    ]
    assert sum(used) == 10
    assert found.counts["too_many"] == 9990
    assert found.take(ship(second=22), NOW + 2 * S)


def test_others_are_used_during_a_flood():
    found = rules()
    for k in range(1000):
        found.take(ship(latitude=k * 1e-3), NOW)
    assert found.take(ship(10), NOW)


def test_transmitters_are_bounded():
    found = rules()
    for address in range(1, MOST + 500):
        found.take(ship(address), NOW)
    assert len(found.known) == MOST


def test_positions_without_any_number_are_all_used():
    found = rules()
    heard = [aircraft(NONE)._replace(space=TRACK_NUMBER, latitude=50.0) for _ in range(50)]
    assert all(found.take(each, NOW) for each in heard)
