import math

import numpy as np
import pytest
from scenario_blocks import FLIGHT, RACE, TARGET, TURN, turning

from phd_jdtc_ros.configuration.build import resolve as resolve_config
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.simulation import scenario, scenario_file
from phd_jdtc_ros.simulation.traffic.flight import Flight, Leg
from phd_jdtc_ros.simulation.traffic.targets import TargetScript, Turn

RADARS = resolve_config({}).model.radars


def resolve(**document):
    return scenario_file.resolve(document, RADARS)


def test_resolve_reads_the_timing_or_takes_the_reference():
    found, reference = resolve(), scenario.paper_scenario(RADARS)
    assert found.targets == ()
    assert found.radars == RADARS
    for name in ("start_ns", "interval_s", "scans"):
        assert getattr(found, name) == getattr(reference, name)
    found = resolve(start_s=12.5, interval_s=0.25, scans=3)
    assert (found.start_ns, found.interval_s, found.scans) == (12_500_000_000, 0.25, 3)
    assert [found.stamp_ns(scan) for scan in range(3)] == [
        12_500_000_000 + 250_000_000 * k for k in range(3)
    ]


def test_resolve_describes_the_reference_scenario():
    reference = scenario.paper_scenario(RADARS)
    targets = [
        {
            "class_id": target.class_id,
            "snr_db": {0: 45.0, 1: 25.0}[target.class_id],
            "position": list(target.position),
            "velocity": list(target.velocity),
            "first_scan": target.first_scan,
            "last_scan": target.last_scan,
        }
        for target in reference.targets
    ]
    assert resolve(targets=targets) == reference


def test_resolve_reads_turns_and_antennas():
    later = {"first_scan": 7, "last_scan": 20, "turn_rate_deg_s": 90}
    (target,) = resolve(**turning(TURN, later)).targets
    assert target.turns == (
        Turn(5, 7, pytest.approx(math.radians(-3.0))),
        Turn(7, 20, pytest.approx(math.pi / 2.0)),
    )
    found = resolve(antennas={"radar_2": {"bearing_deg": 90.0, "clockwise": False}})
    assert found.antennas == (
        scenario.default_antenna(0),
        scenario.Antenna(pytest.approx(math.pi / 2.0), False),
    )


def flown(*turns, interval_s=6.0, velocity=(30.0, 0.0)):
    """Return the states, scan by scan, of a target that lives from scan 2 to scan 30."""
    target = TargetScript(0, 1e3, (100.0, -50.0), velocity, 2, 30, tuple(turns))
    return np.array([target.state_at(scan, interval_s) for scan in range(2, 31)])


@pytest.mark.parametrize("interval_s", [6.0, 1.0 / 3.0])
def test_a_target_without_turns_flies_exactly_straight(interval_s):
    for scan, state in enumerate(flown(interval_s=interval_s, velocity=(30.1, -7.3))):
        elapsed = scan * interval_s
        expected = [100.0 + elapsed * 30.1, 30.1, -50.0 + elapsed * -7.3, -7.3, 0.0]
        assert state.tolist() == expected


def test_turns_are_arcs_that_keep_the_speed():
    rate = math.radians(3.0)
    states = flown(Turn(7, 12, rate))
    scan = np.arange(2, 31)
    heading = rate * 6.0 * np.clip(scan - 7, 0, 5)
    np.testing.assert_allclose(states[:, 1], 30.0 * np.cos(heading), atol=1e-12)
    np.testing.assert_allclose(states[:, 3], 30.0 * np.sin(heading), atol=1e-12)
    np.testing.assert_array_equal(states[:, 4], np.where((scan >= 7) & (scan < 12), rate, 0.0))
    rate = math.radians(2.0)
    states = flown(Turn(2, 30, rate))
    # Counter-clockwise: the centre is to the left of the first velocity.
    radius = 30.0 / rate
    apart = np.hypot(states[:, 0] - 100.0, states[:, 2] - (-50.0 + radius))
    np.testing.assert_allclose(apart, radius, rtol=1e-12)
    np.testing.assert_allclose(flown(Turn(5, 11, 0.0)), flown(), rtol=1e-14)


def test_resolve_reads_targets_with_legs_in_seconds():
    (found,) = resolve(targets=[FLIGHT]).targets
    assert found == Flight(
        class_id=1,
        snr=snr_from_db(30.0),
        start_s=4.0,
        position=(1.0, 2.0),
        velocity=(30.0, 0.0),
        legs=(Leg(20.0), Leg(10.0, math.radians(3.0))),
    )


def test_resolve_numbers_targets_of_all_kinds_for_the_length_of_the_run():
    found = resolve(
        scans=11,
        targets=[{**TARGET, "first_scan": 0}, FLIGHT],
        traffic={"aircraft": 2, "taxiing": 1},
    )
    assert len(found.targets) == 5
    assert scenario.truth_at(found, 5).track_id.tolist()[:2] == [1, 2]
    found = resolve(interval_s=2.0, scans=101, traffic={"aircraft": 5, "taxiing": 2, "seed": 3})
    assert len(found.targets) == 7
    assert max(flight.end_s for flight in found.targets) == pytest.approx(200.0)


def test_resolve_repeats_straight_legs_and_turns():
    race = {**RACE, "heading_deg": 90.0}
    found = resolve(interval_s=4.8, scans=751, world_origin=[52.0, 7.0], manoeuvres=race)
    (flight,) = found.targets
    assert flight.position == (0.0, 0.0)
    assert flight.end_s == pytest.approx(3600.0)
    speed = 240.0 * 1852.0 / 3600.0
    np.testing.assert_allclose(flight.velocity, (speed, 0.0), atol=1e-9)
    assert flight.legs[0].duration_s == pytest.approx(300.0)
    # 60 degrees at 240 kt is 7.9 degrees a second, to the right.
    assert math.degrees(flight.legs[1].turn_rate) == pytest.approx(-7.88, abs=0.01)
    assert math.degrees(flight.legs[1].turn_rate * flight.legs[1].duration_s) == pytest.approx(-175)
    assert flight.legs[2:4] == flight.legs[:2]
    vx, vy = flight.states(np.array([330.0]))[0, [1, 3]]
    assert math.degrees(math.atan2(vx, vy)) == pytest.approx(-95.0)


def test_sites_are_positions_in_the_plane_about_the_origin():
    document = {"world_origin": [52.0, 7.0], "sites": {"mast": [52.0, 7.0], "hill": [53.0, 7.0]}}
    found = scenario_file.site_parameters(document)
    assert found["mast.position"] == [0.0, 0.0]
    np.testing.assert_allclose(found["hill.position"], [0.0, 111195.0], atol=1.0)
    with pytest.raises(ConfigError, match=r"sites\.mast: \[52\.0\] given"):
        scenario_file.site_parameters({"sites": {"mast": [52.0]}})


def test_an_origin_with_a_height_puts_sites_on_the_round_earth():
    mast = [52.5, 7.0, 40.0]
    document = {"world_origin": [52.0, 7.0, 10.0], "sites": {"mast": mast}}
    assert scenario_file.site_parameters(document) == {
        "world_origin": [52.0, 7.0, 10.0],
        "mast.geodetic": mast,
    }
    assert resolve(world_origin=[52.0, 7.0, 10.0]).targets == ()
    with pytest.raises(ConfigError, match="sites: must be a mapping"):
        scenario_file.site_parameters({**document, "sites": [mast]})
