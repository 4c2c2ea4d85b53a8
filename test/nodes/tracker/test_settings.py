from dataclasses import replace

import numpy as np
import pytest
from lone import lone
from refusals import faults_of

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.configuration.parameters.radar import LEARNED
from phd_jdtc_ros.configuration.tables import schema
from phd_jdtc_ros.nodes.tracker.inputs import queue_depth
from phd_jdtc_ros.nodes.tracker.settings import TABLE, change, edit, resolve
from phd_jdtc_ros.parameter_files.node_tables import NAMES
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

USUAL = resolve({})
BORN = resolve({"births": ["gate"]})
SMALL = {"lag": 2}
# Values of parameters whose bounds leave out those that the others can have.
OTHERS = {
    "shared_codes": ["7000"],
    **{f"{radar}.learn": [*LEARNED] for radar in ("radar_1", "radar_2")},
    **{f"{radar}.detection_probability_range": [0.0, 1e4] for radar in ("radar_1", "radar_2")},
}

# Parameters that only change together with others: lists of the same length.
TOGETHER = {
    f"{radar}.clutter_density{one}": {f"{radar}.clutter_density{other}": value}
    for radar in ("radar_1", "radar_2")
    for one, other, value in (("", "_range", [0.0, 1e4]), ("_range", "", [2.0, 1.0]))
}
OTHERS |= {f"{radar}.clutter_density_range": [0.0, 1e4] for radar in ("radar_1", "radar_2")}


def test_resolve_keeps_the_nodes_own_apart_in_a_table_of_all():
    assert not NAMES & schema({}).keys()
    for parameter in TABLE:
        assert parameter.description.endswith(".")
        assert parameter.coerce(parameter.default) == parameter.default
    found = resolve({"outputs": ["paths"], "lag": 3})
    assert (found.node["outputs"], found.config.lag.scans) == (["paths"], 3)
    assert found.values.keys() == found.table.keys()


def test_resolve_lists_the_faults_of_both():
    assert faults_of(resolve, {"autostart": 1, "lag": -1, "survival": 0.9}) == [
        "autostart: 1 given, must be true or false",
        "lag: -1 given, must be a whole number, at least 0, at most 100",
        "survival: unknown parameter",
    ]


def test_mutable_names_are_there():
    assert USUAL.mutable <= USUAL.table.keys()
    assert {"existence", "radar_2.clutter_rate", "gate.rates"} <= BORN.mutable
    assert not {"lag", "sensors", "autostart", "radar_1.topic", "checkpoint.path"} & USUAL.mutable


def test_changed_gives_what_a_start_with_it_gives():
    changes = {
        "radar_2.clutter_rate": 40,
        "existence": [0.7],
        "outputs": ["detections", "frames", "curves"],
    }
    found, fresh = change(USUAL, changes), resolve(changes)
    assert found.values == fresh.values
    assert found.config.model.radars == fresh.config.model.radars
    assert USUAL.values["radar_2.clutter_rate"] == 20.0


def test_changes_are_refused_by_the_whole_configuration():
    (fault,) = faults_of(change, USUAL, {"outputs": ["markers", "paths"]})
    assert fault == "outputs: only markers may come and go while the tracker is configured"
    # Each number is allowed; one target a scan at the most is what they add up to.
    (fault,) = faults_of(change, BORN, {"gate.rates": [0.7, 0.7]})
    assert fault.startswith("gate.rates: [0.7, 0.7] given, must sum to at most 1")


def test_outputs_by_latitude_and_longitude_need_an_origin():
    assert faults_of(resolve, {"outputs": ["navsat", "geojson"]}) == [
        "outputs: navsat given, needs world_origin",
        "outputs: geojson given, needs world_origin",
    ]
    (fault,) = faults_of(resolve, {"outputs": ["navsat"], "world_origin": [120.0]})
    assert fault.endswith("needs world_origin, whose latitude and longitude are unknown")


ORIGIN = {"world_origin": [52.3, 4.8, 0.0]}


def test_streams_need_sound_destinations_and_types_and_places():
    assert faults_of(resolve, {"outputs": ["ttm", "tll", "cot", "signalk"]}) == [
        f"outputs: {name} given, needs world_origin" for name in ("tll", "cot", "signalk")
    ]
    given = {"outputs": ["ttm", "cot"], **ORIGIN, "destinations": ["cot+tcp://there:1"]}
    (fault,) = faults_of(resolve, given)
    assert fault.startswith("destinations: cot+tcp://there:1 given, must be one of nmea, cot, ")
    (fault,) = faults_of(resolve, {**given, "destinations": ["cot+tcp://127.0.0.1:1"]})
    assert fault == "outputs: ttm given, needs nmea+... in destinations"
    (fault,) = faults_of(resolve, {"cot_types": ["a-u-S"]})
    assert fault.startswith("cot_types: ['a-u-S'] given, must be empty or one for each of")
    (fault,) = faults_of(resolve, {"cot_types": ["a-u-S", "vessel"]})
    assert fault == "cot_types: vessel given, must be such as a-u-S"
    resolve({"cot_types": ["a-u-S-X-M", "a-u-S-X-M"]})


def test_relative_bearings_need_a_heading():
    moves = {"outputs": ["ttm_relative"], "radar_1.pose": "/odom"}
    assert resolve(moves).node["outputs"] == ["ttm_relative"]
    for given in ({**moves, "radar_1.pose": "fixed"}, {**moves, "radar_1.pose_yaw": False}):
        (fault,) = faults_of(resolve, given)
        assert fault == "outputs: ttm_relative given, needs pose of a radar, and its heading"


def test_edited_checks_every_value_and_not_yet_the_whole():
    table, values = edit(BORN.values, {"classes": ["a", "b", "c"], "lag": 9})
    assert (values["classes"], values["lag"], table["c.motions"].name) == (
        ["a", "b", "c"],
        9,
        "c.motions",
    )
    assert values["gate.rates"] == [0.005, 0.005]  # Too few, which `resolve` reports
    assert not {name for name in values if name.startswith("class_")}
    assert any(fault.startswith("gate.rates: ") for fault in faults_of(resolve, values))


def test_edited_and_changed_list_every_fault():
    assert faults_of(edit, USUAL.values, {"lag": -1, "class_0.survival": 0.9, "sensors": "x"}) == [
        "sensors: 'x' given, must be a list of distinct names, at most 100",
        "lag: -1 given, must be a whole number, at least 0, at most 100",
        "class_0.survival: unknown parameter, did you mean class_0.survival_probability?",
    ]
    changes = {"radar_1.clutter_rate": -1.0, "lag": 3, "survival": 0.9, "existence": [2.0]}
    assert faults_of(change, USUAL, changes) == [
        "lag: cannot change while the tracker is configured, clean it up before",
        "survival: unknown parameter",
        *faults_of(resolve, {"radar_1.clutter_rate": -1.0, "existence": [2.0]}),
    ]


@pytest.mark.parametrize("name", sorted(USUAL.mutable - NAMES))
def test_changed_parameter_can_be_taken_over_by_a_running_engine(name):
    small = resolve(SMALL)
    value = small.values[name]
    by_type = {bool: not value, int: 1, list: [0.1, 0.05]}
    other = OTHERS.get(name, by_type.get(type(value), 0.3))
    scans = [scan for _, scan in simulate(paper_scenario(small.config.model.radars), 0)[:6]]
    engine = new_engine(small.config)
    for scan in scans[:3]:
        engine.step(scan)
    found = change(small, {name: other, **TOGETHER.get(name, {})})
    assert found.values[name] == other
    engine.retune(found.config.model, found.config.rule)
    for scan in scans[3:]:
        step = engine.step(scan)
        assert np.isfinite(step.filtered[0].state).all()
        assert np.isfinite(step.class_mass).all()


def test_retuned_engine_steps_like_one_that_was_always_so():
    # Learning goes on from what was learned, and not from a new first guess.
    small = resolve({**SMALL, "radar_1.learn": [], "radar_2.learn": []})
    scans = [scan for _, scan in simulate(paper_scenario(small.config.model.radars), 0)[:3]]
    other = change(small, {"radar_1.clutter_rate": 60.0, "existence": [0.3]})
    engine, fresh = new_engine(small.config), new_engine(other.config)
    engine.retune(other.config.model, other.config.rule)
    for scan in scans:
        (ours,), (theirs,) = engine.step(scan).filtered, fresh.step(scan).filtered
        np.testing.assert_array_equal(ours.state, theirs.state)


@pytest.mark.parametrize(
    ("rotation_s", "sectors", "depth"),
    [(0.0, 0, 50), (4.0, 32, 50), (1.0, 128, 128), (0.3, 32, 107)],
)
def test_queue_depth_wait_and_fifty_at_least(rotation_s, sectors, depth):
    radar = replace(lone().inputs[0], rotation_s=rotation_s, sectors=sectors)
    assert queue_depth(radar) == depth
