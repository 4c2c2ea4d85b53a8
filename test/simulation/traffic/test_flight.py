import math

import numpy as np
import pytest

from phd_jdtc_ros.simulation.traffic.flight import Flight, Leg
from phd_jdtc_ros.simulation.traffic.targets import TargetScript, Turn

LEGS = (
    Leg(30.0),
    Leg(20.0, turn_rate=math.radians(3.0)),
    Leg(40.0, acceleration=0.5),
    Leg(25.0, turn_rate=math.radians(-1.5)),
)


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
