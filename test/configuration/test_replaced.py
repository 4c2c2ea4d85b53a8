"""Parameters and notations of before are refused with what takes their place; what is learned."""

import numpy as np
import pytest
import yaml

from phd_jdtc_ros.asterix_bridge import configuration as bridge
from phd_jdtc_ros.asterix_bridge.tracks import MAX_PREDICTION_S
from phd_jdtc_ros.configuration import build, models, sensor_models
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.radar import LEARNED
from phd_jdtc_ros.configuration.schema import ConfigError, check
from phd_jdtc_ros.core.factors import (
    ClutterRate,
    CorrelatedMisses,
    Detection,
    Multipath,
    Noise,
    Outliers,
)
from phd_jdtc_ros.core.factors.transponder.height import HeightModel
from phd_jdtc_ros.evaluation.run_scores import ORDER
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.nodes.tracker import health, live, settings
from phd_jdtc_ros.nodes.tracker import outputs as live_outputs
from phd_jdtc_ros.parameter_files import node_tables

TABLES = (
    *(replaced.TRACKER, replaced.RADAR, replaced.NODE, replaced.EVALUATOR, replaced.BRIDGE),
    replaced.HAND_OVER,
)
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
    [(node_tables.EVALUATOR, replaced.EVALUATOR), (node_tables.REPLAY, replaced.REPLAY)],
    ids=["evaluator", "sensor_replay"],
)
def test_plain_nodes_refuse_the_names_of_before(parameters, table):
    needed = {"bag": "a_bag"} if parameters is node_tables.REPLAY else {}
    _, faults = check(parameters, {**needed, **dict.fromkeys(table, 1)}, table)
    assert faults == refused(table)


def test_the_tracker_refuses_the_names_of_before():
    of_all, of_radar = {**replaced.TRACKER, **replaced.NODE}, replaced.RADAR
    for read in (settings.resolve, build.resolve):
        assert faults_of(read, dict.fromkeys(of_all, 1)) == refused(of_all)
        given = {f"radar_2.{name}": 1 for name in of_radar}
        assert faults_of(read, given) == refused(of_radar, "radar_2.")
        given = {f"start_1.{name}": 1 for name in replaced.BIRTH}
        assert faults_of(read, given) == refused(replaced.BIRTH, "start_1.")


@pytest.mark.parametrize("read", [settings.resolve, build.resolve])
def test_the_tracker_refuses_the_engine_of_before(read):
    assert faults_of(read, {"engine": "particles"}) == [
        "engine: 'particles' given, write engine: gaussian"
    ]


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
        ("height_std", models.HEIGHT_STD),
        ("order", ORDER),
        ("spawn.position_std", models.SPAWN_STD[0]),
        ("spawn.velocity_std", models.SPAWN_STD[1]),
        ("spawn.turn_rate_std", models.SPAWN_STD[2]),
        ("spawn.particles_per_target", models.SPAWN_PARTICLES),
        ("pose_max_speed", models.POSE_MAX_SPEED),
        ("range_rate_span", sensor_models.RANGE_RATE_SPAN),
        ("checkpoint.max_age_s", live.CHECKPOINT_MAX_AGE_S),
        ("path_length", live_outputs.PATH_LENGTH),
        ("silent_after_scans", health.SILENT_AFTER_SCANS),
        ("max_prediction_s", MAX_PREDICTION_S),
        ("smoothed_wait_s", hand_over.SMOOTHED_WAIT_S),
    ],
)
def test_replacement_by_a_constant_gives_its_value(name, value):
    (text,) = (table[name] for table in TABLES if name in table)
    number = text.removeprefix("it is a constant now, ").partition(" ")[0]
    assert float(number) == value


def test_replacements_by_constants_all_have_a_value():
    texts = [text for table in TABLES for text in table.values() if "constant" in text]
    assert len(texts) == 26
    assert all(text.startswith("it is a constant now, ") for text in texts)


def model_of(**given):
    return resolve({f"radar_1.{name}": value for name, value in given.items()}).model


def radar_of(**given):
    return model_of(**given).radars[0]


def factor_of(kind, **given):
    """Return the factor of a kind of the radar; None if it has none."""
    found = model_of(**given).factors["radar_1"]
    return next((factor for factor in found if isinstance(factor, kind)), None)


@pytest.mark.parametrize(
    ("learn", "noise", "outliers", "detection", "correlation", "clutter", "multipath"),
    [
        ([], *[False] * 6),
        (["noise"], True, *[False] * 5),
        (["outliers", "correlation"], False, True, False, True, False, False),
        (["detection", "clutter", "multipath"], False, False, True, False, True, True),
        ([*LEARNED], *[True] * 6),
    ],
)
def test_each_word_of_learn_has_one_thing_learned(
    learn, noise, outliers, detection, correlation, clutter, multipath
):
    given = {"range_std": 45.0, "clutter_rate": 8.0, "detection_probability": 0.8}
    radar = radar_of(learn=learn, **given)
    assert (radar.range_std, radar.clutter_rate) == (45.0, 8.0)
    found = {
        kind: factor_of(kind, learn=learn, **given) is not None
        for kind in (Noise, Outliers, Detection, CorrelatedMisses, ClutterRate, Multipath)
    }
    assert [*found.values()] == [noise, outliers, detection, correlation, clutter, multipath]


def test_the_noise_of_range_rates_is_learned_where_there_are_some():
    assert factor_of(Noise, learn=["noise"]).learned.tolist() == [True, True, False]
    rates = {"learn": ["noise"], "range_rate_std": 0.3, "fields.range_rate": "range_rate"}
    assert factor_of(Noise, **rates).learned.tolist() == [True, True, True]
    assert radar_of(**rates).range_rate.std == 0.3


@pytest.mark.parametrize(
    ("learn", "given", "correlation"),
    [([], 0.0, None), ([], 0.5, (0.5, False)), (["correlation"], 0.3, (0.3, True))],
)
def test_a_correlation_is_given_or_where_learning_begins(learn, given, correlation):
    found = factor_of(CorrelatedMisses, learn=learn, detection_correlation=given)
    assert (found and (found.start, found.learned)) == correlation


@pytest.mark.parametrize(
    ("given", "probability"),
    [
        ({"detection_probability": 0.8}, 0.8),
        ({"detection_probability": 0.8, "detection_probability_range": [0.0, 1e4]}, 0.8),
        ({"detection_probability": [0.9, 0.7], "detection_probability_range": [0.0, 1e4]}, 0.8),
    ],
)
def test_detection_probability_is_a_number_or_one_for_each_range(given, probability):
    found = radar_of(**given).visibility.detection_probability(np.array([[5e3, 0.0]]))
    np.testing.assert_allclose(found, [probability])


@pytest.mark.parametrize("learn", [[], ["detection"], ["correlation"]])
def test_detection_probability_may_follow_from_the_snr_bands(learn):
    radar = radar_of(detection_probability=0.0, learn=learn)
    assert radar.visibility.detection_probability(np.zeros((1, 2))) is None


@pytest.mark.parametrize("value", [0, 4, 3.97])
def test_rotation_period_is_given_or_found_out(value):
    config = resolve({"sensors": ["radar"], "radar.rotation_s": value})
    assert config.radars[0].rotation_s == config.revolutions()[0].configured_period_s == value


SECTIONS = {
    "tracker": (build.resolve, {}, ""),
    "tracker, of each sensor": (build.resolve, {}, "radar_2."),
}
NOTATIONS = [
    (*SECTIONS[section], name, value)
    for section, rows in replaced.NOTATIONS.items()
    if section in SECTIONS
    for name, _, values in rows
    for value in values
]


@pytest.mark.parametrize(("read", "more", "prefix", "name", "value"), NOTATIONS)
def test_a_former_notation_is_refused_with_lines_that_are_accepted(read, more, prefix, name, value):
    (fault,) = faults_of(read, {**more, f"{prefix}{name}": value})
    begin = f"{prefix}{name}: {value!r} given, write "
    assert fault.startswith(begin)
    lines = yaml.safe_load("\n".join(fault.removeprefix(begin).split(" and ")))
    found = read({**more, **{f"{prefix}{key}": own for key, own in lines.items()}})
    assert {key: found.values[f"{prefix}{key}"] for key in lines} == lines


@pytest.mark.parametrize(
    ("name", "value", "lines"),
    [
        ("range_std", "auto 45 outliers", "range_std: 45.0 and learn: [noise, outliers]"),
        ("azimuth_std_deg", "auto", "learn: [noise]"),
        ("clutter_rate", "auto multipath", "learn: [clutter, multipath]"),
        (
            "detection_probability",
            "auto 0 0.9 1e4 0.7 correlated 0.5",
            "detection_probability: [0.9, 0.7] and detection_probability_range: [0.0, 10000.0] "
            "and detection_correlation: 0.5 and learn: [detection]",
        ),
        (
            "detection_probability",
            [0.0, 0.9, 1e4, 0.7],
            "detection_probability: [0.9, 0.7] and detection_probability_range: [0.0, 10000.0]",
        ),
        (
            "pose",
            "/a pose_stamped stabilised",
            "pose: /a and pose_message: pose_stamped and pose_yaw: false",
        ),
    ],
)
def test_the_lines_for_a_former_notation_mean_the_same(name, value, lines):
    (fault,) = faults_of(resolve, {f"radar_1.{name}": value})
    assert fault == f"radar_1.{name}: {value!r} given, write {lines}"


def test_the_evaluator_refuses_messages_after_topics():
    topics = ["/mast/plots", "/ship/odometry odometry"]
    _, (fault,) = check(node_tables.EVALUATOR, {"record_topics": topics})
    assert fault == (
        f"record_topics: {topics!r} given, write record_topics: [/mast/plots, /ship/odometry] and "
        "record_types: [cloud, odometry]"
    )


@pytest.mark.parametrize("topics", [1, "/plots", [""], [1], ["/plots", "/plots"]])
def test_what_is_no_list_of_topics_is_refused(topics):
    _, (fault,) = check(node_tables.EVALUATOR, {"record_topics": topics})
    assert fault == f"record_topics: {topics!r} given, must be a list of distinct topics"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rotation_s", "auto 4"),
        ("rotation_s", -1.0),
        ("rotation_s", "4"),
        ("learn", ["all"]),
        ("learn", ["noise", "noise"]),
        ("detection_probability", "often correlated 0.5"),
        ("detection_probability", "0.8 correlated 0.5 0.6"),
        ("detection_probability", 1.2),
        ("detection_probability", [1.2]),
        ("detection_probability", [0.0, 0.5]),
        ("detection_probability", []),
        ("detection_correlation", 0.99),
        ("range_std", "auto many outliers"),
        ("range_std", "auto 45 60"),
        ("range_std", "nan"),
        ("range_std", "learned"),
        ("azimuth_std_deg", 200.0),
        ("range_rate_std", 2e3),
    ],
)
def test_other_words_and_numbers_are_refused(name, value):
    with pytest.raises(ConfigError, match=rf"radar_1.{name}: .* given, (must be|write detection)"):
        radar_of(**{name: value})
