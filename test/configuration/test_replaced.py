"""Parameters of before are refused with what takes their place; values that may be learned."""

import numpy as np
import pytest

from phd_jdtc_ros.asterix_bridge import settings as bridge
from phd_jdtc_ros.configuration import build, models, radar_models
from phd_jdtc_ros.configuration.build import resolve
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
    for read in (settings.resolve, build.resolve):
        assert faults_of(read, dict.fromkeys(of_all, 1)) == refused(of_all)
        given = {f"radar_2.{name}": 1 for name in of_radar}
        assert faults_of(read, given) == refused(of_radar, "radar_2.")


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


def radar_of(**given):
    return resolve({f"radar_1.{name}": value for name, value in given.items()}).model.radars[0]


@pytest.mark.parametrize(
    ("value", "std", "learned", "outliers"),
    [
        (45.0, 45.0, False, False),
        (45, 45.0, False, False),
        ("auto 45", 45.0, True, False),
        ("auto", 300.0, True, False),
        ("45 outliers", 45.0, False, True),
        ("auto 45 outliers", 45.0, True, True),
        ("auto outliers", 300.0, True, True),
    ],
)
def test_deviation_is_a_number_or_learned_and_may_have_outliers(value, std, learned, outliers):
    radar = radar_of(range_std=value)
    assert radar.range_std == std
    assert (radar.noise_factor is not None) == learned
    assert (radar.outliers is not None) == outliers


def test_each_component_is_learned_alone_if_it_is_used():
    factor = radar_of(azimuth_std_deg="auto 0.08").noise_factor
    assert factor.learned.tolist() == [False, True, False]
    rates = {"range_rate_std": "auto 0.3", "fields.range_rate": "range_rate"}
    assert radar_of(**rates).noise_factor.learned.tolist() == [False, False, True]
    assert radar_of(**rates).range_rate.std == 0.3
    assert radar_of(range_rate_std="auto").noise_factor is None


@pytest.mark.parametrize(
    ("value", "probability", "learned", "correlation"),
    [
        (0.8, 0.8, False, None),
        ("auto 0.8", 0.8, True, None),
        ([0.0, 0.9, 1e4, 0.7], 0.8, False, None),
        ("auto 0 0.9 1e4 0.7", 0.8, True, None),
        ("0.8 correlated 0.5", 0.8, False, (0.5, False)),
        ("0.8 correlated", 0.8, False, (0.0, True)),
        ("auto 0.8 correlated", 0.8, True, (0.0, True)),
        ("0 0.9 1e4 0.7 correlated 0.5", 0.8, False, (0.5, False)),
    ],
)
def test_detection_probability_is_a_number_a_table_or_is_learned_and_may_be_correlated(
    value, probability, learned, correlation
):
    radar = radar_of(detection_probability=value)
    found = radar.configured_detection_probability(np.array([[5e3, 0.0]]))
    np.testing.assert_allclose(found, [probability])
    assert (radar.detection_factor is not None) == learned
    chain = radar.correlation and (radar.correlation.start, radar.correlation.learned)
    assert chain == correlation


def test_correlated_detections_may_follow_from_the_snr_bands():
    radar = radar_of(detection_probability="correlated 0.5")
    assert radar.configured_detection_probability(np.zeros((1, 2))) is None
    assert radar.correlation.start == 0.5


@pytest.mark.parametrize("value", [0.0, "auto"])
def test_detection_probability_may_follow_from_the_snr_bands(value):
    radar = radar_of(detection_probability=value)
    assert radar.configured_detection_probability(np.zeros((1, 2))) is None
    assert (radar.detection_factor is not None) == (value == "auto")


@pytest.mark.parametrize(("value", "period_s"), [("auto", 0.0), (0, 0.0), (4, 4.0), (3.97, 3.97)])
def test_rotation_period_is_given_or_learned(value, period_s):
    config = resolve({"sensors": ["radar"], "radar.rotation_s": value})
    assert config.radars[0].rotation_s == config.turns()[0].configured_period_s == period_s


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rotation_s", "auto 4"),
        ("rotation_s", -1.0),
        ("rotation_s", "4"),
        ("detection_probability", "0.8 correlated 0.99"),
        ("detection_probability", "0.8 correlated -0.1"),
        ("detection_probability", "0.8 correlated 0.5 0.6"),
        ("detection_probability", "1.2 correlated 0.5"),
        ("detection_probability", "often correlated 0.5"),
        ("detection_probability", "0.8 correlated correlated"),
        ("range_std", "45 outliers 0.1"),
        ("range_std", "outliers"),
        ("range_std", "auto many outliers"),
        ("azimuth_std_deg", "1 outliers"),
        ("range_std", "auto 0"),
        ("range_std", "auto 45 60"),
        ("range_std", "auto many"),
        ("range_std", "learned"),
        ("azimuth_std_deg", "auto 200"),
        ("range_rate_std", "auto 2e3"),
        ("range_rate_std", "0.3 outliers"),
        ("detection_probability", "auto 1.5"),
        ("detection_probability", "auto 0 0.9 1e4"),
        ("detection_probability", "auto 1e4 0.9 0 0.7"),
        ("detection_probability", "auto auto"),
        ("detection_probability", []),
    ],
)
def test_other_words_and_numbers_are_refused(name, value):
    with pytest.raises(ConfigError, match=rf"radar_1.{name}: .* given, must be .*auto"):
        radar_of(**{name: value})
