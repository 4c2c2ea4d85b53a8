"""Faults of scenario files, and the messages that refuse them."""

import math
from dataclasses import replace

import pytest
from lone import lone
from refusals import faults_of
from scenario_blocks import FLIGHT, QUAY, RACE, SHIP, TARGET, TURN, UNIFORM, turning

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation import scenario_file

RADARS = resolve({}).model.radars
STILL = lone().model.radars
RATED = lone({"radar.fields.range_rate": "rr", "radar.range_rate_std": 0.2}).model.radars
TURNING = tuple(replace(STILL[0], name=name, rotation_s=4.0) for name in ("one", "other"))
NAMES = "must be one of the radars, radar_1, radar_2"


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


SCANS = "a whole number, at least 1, at most 1e+06"
INTERVAL = "a finite number, at least 1e-09, at most 1e+06"
ABOVE_THRESHOLD = "must be above lowest_db and the radar's threshold"
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
    ({"antennas": {"radar_9": {}}}, f"antennas.radar_9: {NAMES}"),
    (
        {"antennas": {"radar_1": {"bearing_deg": 400.0}}},
        "antennas.radar_1.bearing_deg: 400.0 given, must ",
    ),
    ({"antennas": {"radar_1": {"speed": 1.0}}}, "antennas.radar_1.speed: unknown key"),
    ({"antennas": [1]}, "antennas: must be a mapping"),
    ({"clutter": [1]}, "clutter: must be a mapping"),
    ({"clutter": {"mast": UNIFORM}}, f"clutter.mast: {NAMES}"),
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
OF_TURNING = [
    ({"biases": {"mine": {}}}, "biases.mine: must be one of the radars, one, other"),
    ({"biases": {"one": {"range": 1.0}}}, "biases.one.range: unknown key"),
    ({"biases": {"one": {"range_gain": 2.0}}}, "biases.one.range_gain: 2.0 given, must be"),
    ({"biases": {"one": 5.0}}, "one: must be a mapping"),
    ({"biases": 5.0}, "biases: must be a mapping"),
    ({"echoes": {"one": {}}}, "echoes.one: given, must be absent"),
]
OF_STILL = [
    ({"echoes": {"other": {}}}, "echoes.other: must be one of the radars, radar"),
    ({"echoes": {"radar": {"probability": 2.0}}}, "echoes.radar.probability: 2.0 given"),
    ({"echoes": {"radar": {"sideways": 2.0}}}, "echoes.radar.sideways: unknown key"),
    (quay(points=[1.0]), "reflectors[0].points: must be x and y"),
    (quay(points=[]), "reflectors[0].points: must be x and y"),
    (quay(high=1), "reflectors[0].high: unknown key"),
    (quay(spacing=0.01), "reflectors[0].spacing: 0.01 given, must be at least 0.2"),
    (
        quay(detection_probability=1.5),
        "reflectors[0].detection_probability: 1.5 given",
    ),
    (quay(amplitude={"law": "gamma"}), "reflectors[0].amplitude.law: 'gamma' given"),
    (ship(radars=["bow"]), "platform.radars: 'bow' given, must be some"),
    (ship(radars=[]), "platform.radars: none given"),
    (ship(legs=[]), "platform.legs: none given"),
    (
        ship(legs=[{"duration_s": 20.0, "acceleration": -1.0}]),
        "platform.legs: a speed of -10 m/s",
    ),
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
