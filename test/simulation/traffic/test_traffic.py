import math
from dataclasses import replace

import numpy as np
import pytest
from reference import resolve

from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import (
    EARTH_RADIUS,
    Flight,
    Gap,
    Leg,
    TargetScript,
    Turn,
    east_north,
    in_gap,
    read_gaps,
)
from phd_jdtc_ros.simulation.traffic import APRON, Traffic, draw
from studies.runner import until

CENTRE = (2e3, -1.5e3)
BUSY = Traffic(aircraft=50, taxiing=13, seed=4, centre=CENTRE, duration_s=480.0)
GIVEN = {"count": 2, "shortest_s": 10.0, "longest_s": 120.0, "seed": 3}
LEGS = (
    Leg(30.0),
    Leg(20.0, turn_rate=math.radians(3.0)),
    Leg(40.0, acceleration=0.5),
    Leg(25.0, turn_rate=math.radians(-1.5)),
)
ORIGIN = (52.0, 7.0)


@pytest.fixture(scope="module")
def flights():
    return draw(BUSY)


def states(flight):
    return flight.states(np.arange(flight.start_s, flight.end_s, 0.5))


def test_traffic_of_a_seed_is_the_same_with_more_aircraft(flights):
    assert len(flights) == 63
    for flight in flights:
        assert 0.0 <= flight.start_s < flight.end_s <= BUSY.duration_s + 1e-6
    assert draw(BUSY) == flights
    assert draw(replace(BUSY, seed=5)) != flights
    more = draw(replace(BUSY, aircraft=60, taxiing=14))
    assert more[:50] == flights[:50]
    assert more[60:73] == flights[50:]


def test_aircraft_fly_turn_and_taxi_as_aircraft_do(flights):
    for flight in flights[:50]:
        found = states(flight)
        speed = np.hypot(found[:, 1], found[:, 3])
        assert 60.0 < speed.min() <= speed.max() < 260.0
        assert np.abs(np.degrees(found[:, 4])).max() <= 3.0 + 1e-9
        assert np.degrees(np.arctan(speed * np.abs(found[:, 4]) / 9.81)).max() < 27.1
        assert np.hypot(*(found[:, [0, 2]] - CENTRE).T).max() <= BUSY.radius + 300.0
    turning = [any(leg.turn_rate for leg in flight.legs) for flight in flights[:50]]
    changing = [any(leg.acceleration for leg in flight.legs) for flight in flights[:50]]
    assert np.mean(turning) > 0.7
    assert np.mean(changing) > 0.3
    for flight in flights[50:]:
        found = states(flight)
        assert np.hypot(found[:, 1], found[:, 3]).max() <= 10.0 + 1e-9
        assert np.hypot(*(found[0, [0, 2]] - CENTRE)) <= APRON
        assert flight.end_s == pytest.approx(BUSY.duration_s)


def test_some_arrive_and_some_depart_during_the_run(flights):
    landed = [f for f in flights[:50] if f.end_s < BUSY.duration_s - 1.0]
    started = [f for f in flights[:50] if f.start_s > 1.0]

    def on_the_runway(flight, time_s):
        state = flight.states(np.array([time_s]))[0]
        return np.hypot(*(state[[0, 2]] - CENTRE)) <= 1001.0

    assert sum(on_the_runway(flight, flight.end_s) for flight in landed) >= 3
    assert sum(on_the_runway(flight, flight.start_s) for flight in started) >= 3


def test_entering_aircraft_come_in_over_the_edge_all_through_the_run():
    hour = replace(BUSY, aircraft=3, taxiing=2, duration_s=3600.0)
    flights = draw(replace(hour, entering=60))
    assert flights[:5] == draw(hour)
    entering = flights[5:]
    assert len(entering) == 60
    begun = [flight for flight in entering if flight.start_s > 0.0]
    assert len(begun) > 40
    for flight in begun:
        away = np.subtract(flight.position, CENTRE)
        assert np.hypot(*away) == pytest.approx(hour.radius, abs=1.5)
        assert np.dot(away, flight.velocity) < 0.0
    assert np.quantile([flight.start_s for flight in begun], 0.75) > 2000.0


def test_traffic_flies_the_given_legs_and_turns():
    calm = replace(BUSY, straight_s=(300.0, 400.0), turn_deg=(5.0, 20.0))
    for flight in draw(calm)[:50]:
        turned = [np.degrees(abs(leg.turn_rate)) * leg.duration_s for leg in flight.legs]
        assert max(turned) <= 20.0 + 1e-9


def flight(speed, length_s, start_s=100.0):
    return Flight(0, 1e3, start_s, (0.0, 0.0), (speed, 0.0), (Leg(length_s),))


FLIGHTS = [flight(200.0, 900.0), flight(5.0, 3000.0), flight(150.0, 80.0), flight(100.0, 1800.0)]


def drawn(**changes):
    faults = []
    found = read_gaps({"gaps": {**GIVEN, **changes}}, FLIGHTS, faults)
    return found, faults


def test_gaps_are_of_fast_targets_that_are_there_before_and_after():
    for seed in range(20):
        found, faults = drawn(seed=seed)
        assert not faults
        # None for one that taxis, and for one that is there for too short a time.
        assert sorted(gap.number for gap in found) == [1, 4]
        for gap in found:
            own = FLIGHTS[gap.number - 1]
            assert 10.0 <= gap.end_s - gap.start_s <= 120.0
            assert own.start_s + 60.0 <= gap.start_s
            assert gap.end_s <= own.end_s - 60.0 + 1e-9


def test_gaps_are_those_of_a_seed_that_fit():
    assert drawn() == drawn()
    assert drawn()[0] != drawn(seed=4)[0]
    assert len(drawn(count=10)[0]) == 2
    faults = []
    assert read_gaps({"gaps": GIVEN}, [], faults) == ()
    assert not faults


def test_target_is_hidden_in_its_own_gaps_in_any_part_of_the_run():
    known = [Gap(1, 5.0, 6.0), Gap(2, 0.0, 9.0), Gap(1, 7.0, 8.0)]
    out = in_gap(known, 1, np.array([4.9, 5.0, 6.0, 7.5, 8.5]))
    assert out.tolist() == [False, True, False, True, False]
    targets = (flight(200.0, 900.0, 700.0), flight(150.0, 900.0, 10.0), flight(100.0, 900.0))
    known = (Gap(1, 800.0, 850.0), Gap(2, 80.0, 90.0), Gap(3, 200.0, 220.0))
    radars = resolve({}).model.radars
    part = until(Scenario(1, 1.0, 3601, targets, radars, gaps=known), 500.0)
    assert part.targets == targets[1:]
    assert part.gaps == (Gap(1, 80.0, 90.0), Gap(2, 200.0, 220.0))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"count": -1}, "gaps.count: -1 given"),
        ({"other": 1}, "gaps.other: unknown key"),
        ({"longest_s": 5.0}, "gaps.longest_s: 5 given, must be at least shortest_s, 10"),
    ],
)
def test_gaps_name_what_is_wrong(changes, fault):
    found, faults = drawn(**changes)
    assert found == ()
    assert faults[0].startswith(fault)


def flown(*legs, velocity=(100.0, 0.0), start_s=10.0):
    return Flight(0, 1e3, start_s, (500.0, -200.0), velocity, legs or LEGS)


def test_a_flight_moves_turns_and_accelerates_by_its_legs():
    flight = flown()
    time = np.arange(10.0, flight.end_s, 1e-3)
    state = flight.states(time)
    moved = np.cumsum(0.5e-3 * (state[1:, [1, 3]] + state[:-1, [1, 3]]), axis=0)
    np.testing.assert_allclose(state[1:, [0, 2]], state[0, [0, 2]] + moved, atol=1e-3)
    vx, vy = flight.states(np.array([10.0, 39.0, 60.0, 80.0, 100.0, 125.0]))[:, [1, 3]].T
    np.testing.assert_allclose(np.hypot(vx, vy), [100.0, 100.0, 100.0, 110.0, 120.0, 120.0])
    course = np.degrees(np.arctan2(vy, vx))
    np.testing.assert_allclose(course, [0.0, 0.0, 60.0, 60.0, 60.0, 22.5], atol=1e-9)
    rates = flown().states(np.array([10.0, 40.0, 59.0, 60.0, 100.0]))[:, 4]
    np.testing.assert_allclose(np.degrees(rates), [0.0, 3.0, 3.0, 0.0, -1.5])


def test_a_flight_exists_until_its_last_leg_ends_in_its_direction():
    flight = flown(Leg(0.1), Leg(0.2), start_s=0.3)
    assert flight.end_s == pytest.approx(0.6)
    assert [scan for scan in range(10) if flight.state_at(scan * 0.1) is not None] == [3, 4, 5, 6]
    stop = flown(Leg(10.0, acceleration=-10.0), Leg(5.0), Leg(10.0, acceleration=1.0))
    states = stop.states(np.array([20.0, 24.0, 35.0]))
    np.testing.assert_allclose(states[0], states[1], atol=1e-9)
    np.testing.assert_allclose(states[2, [1, 3]], [10.0, 0.0], atol=1e-9)


def test_impossible_speeds_and_accelerations_are_refused():
    with pytest.raises(ValueError, match="a speed of -20 m/s, expected none below 0"):
        flown(Leg(12.0, acceleration=-10.0))
    with pytest.raises(ValueError, match=r"acceleration: 1\.0 given, must be 0 in a turn"):
        Leg(5.0, 0.1, 1.0)


@pytest.mark.parametrize(
    ("leg", "fault"),
    [({"duration_s": 0.0}, "duration_s: 0.0"), ({"duration_s": math.nan}, "duration_s: nan")],
)
def test_a_leg_refuses_no_duration(leg, fault):
    with pytest.raises(ValueError, match=fault):
        Leg(**leg)


def test_a_script_in_scans_is_the_same_flight_in_seconds():
    script = TargetScript(1, 1e3, (100.0, -50.0), (30.0, 5.0), 2, 30, (Turn(4, 9, 0.05),))
    flight = script.flight(6.0)
    for scan in range(2, 31):
        expected = script.state_at(scan, 6.0)
        np.testing.assert_allclose(flight.state_at(scan * 6.0), expected, rtol=1e-12, atol=1e-9)
    assert flight.state_at(6.0) is None
    assert flight.state_at(31 * 6.0) is None
    flight = TargetScript(0, 1e3, (0.0, 0.0), (1.0, 0.0), 3, 3).flight(6.0)
    assert [scan for scan in range(6) if flight.state_at(scan * 6.0) is not None] == [3]


def test_the_origin_is_at_zero_with_north_up_and_east_right():
    assert east_north(ORIGIN, ORIGIN) == (0.0, 0.0)
    east, north = east_north((53.0, 7.0), ORIGIN)
    assert east == pytest.approx(0.0, abs=1e-6)
    assert north == pytest.approx(60.0 * 1852.0, rel=2e-3)
    east, north = east_north((52.0, 7.5), ORIGIN)
    half_a_degree = math.radians(0.5) * EARTH_RADIUS * math.cos(math.radians(52.0))
    assert east == pytest.approx(half_a_degree, rel=1e-3)
    assert 0.0 < north < 0.01 * east


@pytest.mark.parametrize("place", [(49.3, 7.9), (54.0, 10.0), (50.9, 4.6), (52.0, 12.0)])
def test_distances_from_the_origin_are_those_on_the_sphere(place):
    (lat, lon), (lat_0, lon_0) = (map(math.radians, point) for point in (place, ORIGIN))
    haversine = (
        math.sin(0.5 * (lat - lat_0)) ** 2
        + math.cos(lat) * math.cos(lat_0) * math.sin(0.5 * (lon - lon_0)) ** 2
    )
    expected = 2.0 * EARTH_RADIUS * math.asin(math.sqrt(haversine))
    assert math.hypot(*east_north(place, ORIGIN)) == pytest.approx(expected, rel=1e-9)
