from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.simulation.traffic.traffic import APRON, Traffic, draw

CENTRE = (2e3, -1.5e3)
BUSY = Traffic(aircraft=50, taxiing=13, seed=4, centre=CENTRE, duration_s=480.0)


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
