"""A parameter of before is refused with what takes its place, by every node."""

import pytest

from phd_jdtc_ros.asterix_bridge import settings as bridge
from phd_jdtc_ros.configuration import build, models, radar_models
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.schema import ConfigError, check
from phd_jdtc_ros.core.attributes.height import HeightModel
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.nodes.tracker import input_health, live, settings
from phd_jdtc_ros.nodes.tracker import outputs as live_outputs
from phd_jdtc_ros.parameter_files import evaluator, sensor_replay

REGIONS = {
    "trackers": ["west", "east"],
    "west.region": [-1.0, 0.0, 0.0, 1.0, 0.1],
    "east.region": [0.0, 0.0, 1.0, 1.0, 0.1],
}


def faults_of(resolve, given):
    with pytest.raises(ConfigError) as caught:
        resolve(given)
    return list(caught.value.faults)


def refused(table, prefix=""):
    return [f"{prefix}{name}: no longer a parameter, {now}" for name, now in table.items()]


@pytest.mark.parametrize(
    ("parameters", "table"),
    [(evaluator.TABLE, replaced.EVALUATOR), (sensor_replay.AT_THE_START, replaced.REPLAY)],
    ids=["evaluator", "sensor_replay"],
)
def test_plain_nodes_refuse_the_names_of_before(parameters, table):
    needed = {"bag": "a_bag"} if parameters is sensor_replay.AT_THE_START else {}
    _, faults = check(parameters, {**needed, **dict.fromkeys(table, 1)}, table)
    assert faults == refused(table)


def test_the_tracker_refuses_the_names_of_before():
    of_all, of_radar = {**replaced.TRACKER, **replaced.NODE}, replaced.RADAR
    for resolve in (settings.resolve, build.resolve):
        assert faults_of(resolve, dict.fromkeys(of_all, 1)) == refused(of_all)
        given = {f"radar_2.{name}": 1 for name in of_radar}
        assert faults_of(resolve, given) == refused(of_radar, "radar_2.")


def test_bridge_and_hand_over_refuse_the_names_of_before():
    given = {"radars": ["a"], **dict.fromkeys(replaced.BRIDGE, 1)}
    assert faults_of(bridge.resolve, given) == refused(replaced.BRIDGE)
    given = {"radars": ["a"], **{f"a.{name}": 1 for name in replaced.BRIDGE_RADAR}}
    assert faults_of(bridge.resolve, given) == refused(replaced.BRIDGE_RADAR, "a.")
    given = {**REGIONS, **dict.fromkeys(replaced.HAND_OVER, 1)}
    assert faults_of(hand_over.resolve, given) == refused(replaced.HAND_OVER)
    given = {**REGIONS, **{f"west.{name}": 1 for name in replaced.HAND_OVER_TRACKER}}
    assert faults_of(hand_over.resolve, given) == refused(replaced.HAND_OVER_TRACKER, "west.")


def test_changes_of_a_running_tracker_are_refused_alike():
    usual = settings.resolve({})
    for change in (settings.change, lambda known, c: settings.edit(known.values, c)):
        with pytest.raises(ConfigError, match="publish_path: no longer a parameter, use outputs"):
            change(usual, {"publish_path": True})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_hypotheses", build.MOST_HYPOTHESES),
        ("max_particles", build.MOST_PARTICLES),
        ("amplitude_jitter", models.AMPLITUDE_JITTER),
        ("reply_probability", models.REPLY_PROBABILITY),
        ("code_garbled", models.GARBLED_PROBABILITY),
        ("height_garbled", models.GARBLED_PROBABILITY),
        ("shared_code_probability", models.SHARED_CODE_PROBABILITY),
        ("code_kept_s", models.CODE_KEPT_S),
        ("clutter_reply_probability", models.CLUTTER_REPLY_PROBABILITY),
        ("height_noise_density", models.HEIGHT_NOISE_DENSITY),
        ("height_climb_std", models.HEIGHT_CLIMB_STD),
        ("height_evidence", HeightModel(1.0, 1.0, 1.0).evidence),
        ("spawn.position_std", models.SPAWN_STD[0]),
        ("spawn.velocity_std", models.SPAWN_STD[1]),
        ("spawn.turn_rate_std", models.SPAWN_STD[2]),
        ("spawn.particles_per_target", models.SPAWN_PARTICLES),
        ("pose_max_speed", models.POSE_MAX_SPEED),
        ("clutter_std_db", radar_models.CLUTTER_STD_DB),
        ("range_rate_span", radar_models.RANGE_RATE_SPAN),
        ("checkpoint.max_age_s", live.CHECKPOINT_MAX_AGE_S),
        ("path_length", live_outputs.PATH_LENGTH),
        ("silent_after_scans", input_health.SILENT_AFTER_SCANS),
        ("max_prediction_s", bridge.MAX_PREDICTION_S),
        ("smoothed_wait_s", hand_over.SMOOTHED_WAIT_S),
    ],
)
def test_replacement_by_a_constant_gives_its_value(name, value):
    tables = (replaced.TRACKER, replaced.RADAR, replaced.NODE, replaced.BRIDGE, replaced.HAND_OVER)
    (text,) = (table[name] for table in tables if name in table)
    number = text.removeprefix("it is a constant now, ").partition(" ")[0]
    assert float(number) == value


def test_replacements_by_constants_all_have_a_value():
    tables = (replaced.TRACKER, replaced.RADAR, replaced.NODE, replaced.BRIDGE, replaced.HAND_OVER)
    texts = [text for table in tables for text in table.values() if "constant" in text]
    assert len(texts) == 25
    assert all(text.startswith("it is a constant now, ") for text in texts)
