import math
from dataclasses import replace

import numpy as np
import pytest
from lone import lone
from reference import resolve as resolve_config
from refusals import faults_of
from scenario_blocks import FLIGHT, QUAY, RACE, SHIP, TARGET, TURN, UNIFORM, turning

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.simulation import scenario, scenario_file
from phd_jdtc_ros.simulation.targets import Flight, Leg, TargetScript, Turn

RADARS = resolve_config({}).model.radars
STILL = lone().model.radars
RATED = lone({"radar.fields.range_rate": "rr", "radar.range_rate_std": 0.2}).model.radars
TURNING = tuple(replace(STILL[0], name=name, rotation_s=4.0) for name in ("one", "other"))
ONE_OF_RADARS = "must be one of the radars, radar_1, radar_2"
SCANS = "a whole number, at least 1, at most 1e+06"
INTERVAL = "a finite number, at least 1e-09, at most 1e+06"
ABOVE_THRESHOLD = "must be above lowest_db and the radar's threshold"
OF_TURNING = [
    ({"biases": {"mine": {}}}, "biases.mine: must be one of the radars, one, other"),
    ({"biases": {"one": {"range": 1.0}}}, "biases.one.range: unknown key"),
    ({"biases": {"one": {"range_gain": 2.0}}}, "biases.one.range_gain: 2.0 given, must be"),
    ({"biases": {"one": 5.0}}, "one: must be a mapping"),
    ({"biases": 5.0}, "biases: must be a mapping"),
    ({"echoes": {"one": {}}}, "echoes.one: given, must be absent"),
]


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


def faults(document, radars=RADARS):
    return faults_of(scenario_file.resolve, document, radars)


def turning_from_to(*scans):
    return turning(*({**TURN, "first_scan": first, "last_scan": last} for first, last in scans))


def target(**changes):
    return {"targets": [TARGET, {**TARGET, **changes}]}


def flight(**changes):
    return {"targets": [{**FLIGHT, **changes}]}


def race(**changes):
    return {"manoeuvres": {**RACE, **changes}}


def clutter(**law):
    return {"clutter": {"radar_1": law}}


def quay(**changes):
    return {"reflectors": [{**QUAY, **changes}]}


def ship(**changes):
    return {"platform": {"radars": ["radar"], **SHIP, **changes}}


OF_PAPER = [
    *((document, "scenario: must be a mapping") for document in (None, [], "text", 3)),
    *(
        ({"targets": targets}, "targets: must be a list of mappings")
        for targets in (None, {}, "text", [1], [[]], [TARGET, None])
    ),
    ({"start_s": 0}, "start_s: 0 given, must be a finite number, at least 0.001"),
    ({"start_s": -1.0}, "start_s: -1.0 given, must be a finite number, at least 0"),
    ({"start_s": math.nan}, "start_s: nan given, must be a finite number, at least 0"),
    ({"start_s": 2**31 - 10.0, "interval_s": 5.0, "scans": 3}, "start_s"),
    ({"interval_s": 0.0}, f"interval_s: 0.0 given, must be {INTERVAL}"),
    ({"interval_s": "6"}, f"interval_s: '6' given, must be {INTERVAL}"),
    ({"scans": 0}, f"scans: 0 given, must be {SCANS}"),
    ({"scans": 2.5}, f"scans: 2.5 given, must be {SCANS}"),
    ({"scans": True}, f"scans: True given, must be {SCANS}"),
    *(
        (target(**{name: value}), f"targets[1].{name}: {value!r} given, must be ")
        for name, values in {
            "class_id": (-1, 0.5),
            "snr_db": (math.inf, None),
            "position": ([1.0], [1.0, "2"], 3.0),
            "velocity": ([1.0, 2.0, 3.0], [math.nan, 0.0]),
            "first_scan": (-1,),
            "last_scan": ("end", 4),
            "height": (90e3,),
        }.items()
        for value in values
    ),
    *(
        (
            {"targets": [{key: value for key, value in TARGET.items() if key != name}]},
            f"targets[0].{name}: missing, must be ",
        )
        for name in TARGET
    ),
    *(
        (target(turns=turns), "targets[1].turns: must be a list of mappings")
        for turns in (None, {}, "left", [3], [[]])
    ),
    *(
        (turning(TURN, {**TURN, name: v}), f"targets[0].turns[1].{name}: {v!r} given, must be ")
        for name, v in (
            *(("first_scan", -1), ("first_scan", 5.5), ("last_scan", "end")),
            *(("turn_rate_deg_s", value) for value in (math.nan, 181.0, [3.0])),
        )
    ),
    *(
        (turning_from_to(*scans), f"targets[0].turns{fault}")
        for scans, fault in (
            ([(4, 7)], "[0].first_scan: 4 given, must be at least 5, when the target appears"),
            ([(5, 5)], "[0].last_scan: 5 given, must be above its first_scan, 5"),
            ([(7, 6)], "[0].last_scan: 6 given, must be above its first_scan, 7"),
            ([(7, 21)], "[0].last_scan: 21 given, must be above its first_scan, 7, and at most"),
            ([(5, 9), (8, 12)], "[1].first_scan: 8 given, must be at least 9"),
        )
    ),
    (flight(legs=[]), "targets[0].legs: none given, must be at least one"),
    (flight(legs=3), "targets[0].legs: must be a list of mappings"),
    (flight(legs=[{}]), "targets[0].legs[0].duration_s: missing, must be "),
    (flight(legs=[{"duration_s": 0.0}]), "targets[0].legs[0].duration_s: 0.0 given, must be "),
    (
        flight(legs=[{"duration_s": 1.0, "turn_rate_deg_s": 1.0, "acceleration": 2.0}]),
        "targets[0].legs[0].acceleration: 2.0 given, must be 0 in a turn",
    ),
    (
        flight(legs=[{"duration_s": 31.0, "acceleration": -1.0}]),
        "targets[0].legs: a speed of -1 m/s, expected none below 0",
    ),
    (flight(start_s=-1.0), "targets[0].start_s: -1.0 given, must be "),
    (flight(first_scan=0), "targets[0].first_scan: unknown key"),
    ({"traffic": 3}, "traffic: must be a mapping"),
    ({"traffic": {"aircraft": -1}}, "traffic.aircraft: -1 given, must be "),
    ({"traffic": {"airplanes": 1}}, "traffic.airplanes: unknown key"),
    (race(flights=[[240.0, 0.0, 52.0, 7.0]]), "manoeuvres.flights[0]: "),
    (race(flights=[[240.0, 60.0]]), "manoeuvres.flights[0]: [240.0, 60.0] given, must be "),
    (race(flights="one"), "manoeuvres.flights[0]: 'one' given, must be "),
    (race(straight_nm=0.0), "manoeuvres.straight_nm: 0.0 given, must be "),
    (race(bank=3), "manoeuvres.bank: unknown key"),
    *(
        ({"world_origin": v}, f"world_origin: {v!r} given, must be a latitude and a longitude")
        for v in (3.0, [95.0, 7.0], [52.0], ["north", 1.0])
    ),
    ({"antennas": {"radar_9": {}}}, f"antennas.radar_9: {ONE_OF_RADARS}"),
    (
        {"antennas": {"radar_1": {"bearing_deg": 400.0}}},
        "antennas.radar_1.bearing_deg: 400.0 given, must ",
    ),
    ({"antennas": {"radar_1": {"speed": 1.0}}}, "antennas.radar_1.speed: unknown key"),
    ({"antennas": [1]}, "antennas: must be a mapping"),
    ({"clutter": [1]}, "clutter: must be a mapping"),
    ({"clutter": {"mast": UNIFORM}}, f"clutter.mast: {ONE_OF_RADARS}"),
    ({"clutter": {"radar_1": 3}}, "clutter.radar_1: must be a mapping"),
    (clutter(), "clutter.radar_1.law: missing, must be one of rayleigh, log_normal, "),
    (clutter(law="k"), "clutter.radar_1.law: 'k' given, must be one of rayleigh, "),
    (clutter(**UNIFORM, std_db=1.0), "clutter.radar_1.std_db: unknown key"),
    (clutter(law="log_normal", level_db=1.0), "clutter.radar_1.std_db: missing, "),
    *(
        (
            clutter(law="uniform", lowest_db=lowest, highest_db=8.0),
            f"clutter.radar_1.highest_db: 8 given, {ABOVE_THRESHOLD}, {least} dB",
        )
        for lowest, least in ((10.0, "10.0"), (-9.0, "8.4"))
    ),
    (
        {"biases": {"radar_1": {"range_bias": 80.0}}},
        "biases: given, must be none where no radar turns",
    ),
]


OF_STILL = [
    ({"echoes": {"other": {}}}, "echoes.other: must be one of the radars, radar"),
    ({"echoes": {"radar": {"probability": 2.0}}}, "echoes.radar.probability: 2.0 given"),
    ({"echoes": {"radar": {"sideways": 2.0}}}, "echoes.radar.sideways: unknown key"),
    (quay(points=[1.0]), "reflectors[0].points: must be x and y"),
    (quay(points=[]), "reflectors[0].points: must be x and y"),
    (quay(high=1), "reflectors[0].high: unknown key"),
    (quay(spacing=0.01), "reflectors[0].spacing: 0.01 given, must be at least 0.2"),
    (quay(detection_probability=1.5), "reflectors[0].detection_probability: 1.5 given"),
    (quay(amplitude={"law": "gamma"}), "reflectors[0].amplitude.law: 'gamma' given"),
    (ship(radars=["bow"]), "platform.radars: 'bow' given, must be some"),
    (ship(radars=[]), "platform.radars: none given"),
    (ship(legs=[]), "platform.legs: none given"),
    (ship(legs=[{"duration_s": 20.0, "acceleration": -1.0}]), "platform.legs: a speed of -10 m/s"),
]


OF_RATED = [(ship(), "platform.radars: 'radar' has range rates")]


@pytest.mark.parametrize(
    ("radars", "document", "fault"),
    [
        (radars, *case)
        for radars, cases in (
            (RADARS, OF_PAPER),
            (TURNING, OF_TURNING),
            (STILL, OF_STILL),
            (RATED, OF_RATED),
        )
        for case in cases
    ],
)
def test_resolve_names_the_fault(radars, document, fault):
    (found,) = faults(document, radars)
    assert found.startswith(fault)


def test_resolve_refuses_unknown_keys():
    assert faults({"speed": 1, "targets": [{**TARGET, "colour": "red"}]}) == [
        "speed: unknown key",
        "targets[0].colour: unknown key",
    ]
    other, missing = faults(turning({"first_scan": 5, "last_scan": 7, "turn_rate": 0.1}))
    assert other == "targets[0].turns[0].turn_rate: unknown key"
    assert missing.startswith("targets[0].turns[0].turn_rate_deg_s: missing, must be ")


def test_resolve_lists_every_fault():
    found = faults({"scans": 0, "what": 1, "targets": [{**TARGET, "class_id": -1}, {}]})
    assert len(found) == 3 + len(TARGET)
