import math
import time

import numpy as np
import pytest
import reference

from phd_jdtc_ros.columns import ground_ranges
from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.radar import LEARNED
from phd_jdtc_ros.configuration.parameters.tracker import MOST_CLASSES, PHD
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tables import GROUPS, schema
from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.factors.transponder import Pressure
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD, HeightPrior, ReportedHeights
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.state_space import PLANAR, SPATIAL
from phd_jdtc_ros.earth import SystemPlane


def faults_of(given):
    with pytest.raises(ConfigError) as caught:
        reference.resolve(given)
    return list(caught.value.faults)


def test_resolve_keeps_values_and_what_it_was_given():
    values = reference.resolve({"lag": 3, "radar_1.range_std": 100}).values
    assert values["lag"] == 3
    assert values["radar_1.range_std"] == 100.0
    assert values["radar_2.range_std"] == 300.0
    given = {"lag": 2, "births": ["here"], "here.position": [1, 2]}
    build.resolve(given)
    assert given == {"lag": 2, "births": ["here"], "here.position": [1, 2]}


def test_resolve_names_the_inputs_and_the_topic_of_one_platform():
    first, second = reference.resolve({"radar_2.topic": "/x", "radar_2.frame": "y"}).inputs
    assert (first.topic, first.frame) == ("/radar_1/detections", "radar_1")
    assert (second.topic, second.frame) == ("/x", "y")
    assert not first.units.compass
    assert not first.units.in_db
    config = reference.resolve({"radar_1.pose": "/ship", "radar_2.pose": "/ship"})
    assert config.radars_by_platform == {"/ship": [0, 1]}
    assert all(config.platforms())
    assert reference.resolve({}).platforms() == (None, None)


def test_resolve_finds_no_faults_in_the_parameters_of_a_faulty_list():
    given = {"sensors": ["a", "a"], "a.range_std": 30.0, "a.position": [1.0, 2.0], "lagg": 3}
    listed, unknown = faults_of(given)
    assert listed.startswith("sensors: ['a', 'a'] given, must be a list of distinct names")
    assert unknown == "lagg: unknown parameter, did you mean lag?"


def test_resolve_lists_every_fault_at_once_with_name_value_and_what_is_allowed():
    faults = faults_of(
        {
            "lag": -1,
            "interval_s": float("nan"),
            "radar_1.range_std": float("inf"),
            "start_1.position": [1.0],
            "engine": "none",
            "radar_1.clutter_map": 1,
            "no.such": 3,
        }
    )
    expected = {
        "lag": ("-1", "a whole number, at least 0, at most 100"),
        "interval_s": ("nan", "a finite number"),
        "radar_1.range_std": ("inf", "a finite number"),
        "start_1.position": ("[1.0]", "a list of 2 finite numbers"),
        "engine": ("'none'", "one of gaussian, phd, phd_as_printed, phd_gaussian"),
        "radar_1.clutter_map": ("1", "true or false"),
        "no.such": ("", "unknown parameter"),
    }
    assert len(faults) == len(expected)
    found = dict(fault.split(": ", 1) for fault in faults)
    for name, (value, allowed) in expected.items():
        assert value in found[name]
        assert allowed in found[name]


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ("lga", "lga: unknown parameter, did you mean lag?"),
        ("intervall_s", "intervall_s: unknown parameter, did you mean interval_s?"),
        (
            "radar_2.rang_std",
            "radar_2.rang_std: unknown parameter, did you mean radar_2.range_std?",
        ),
        (
            "radr_2.range_std",
            "radr_2.range_std: unknown parameter, did you mean radar_2.range_std?",
        ),
        ("radr_2.lag", "radr_2.lag: unknown parameter"),
        (
            "radar_3.fields.range",
            "radar_3.fields.range: unknown parameter, radar_3 is not in sensors (radar_1, radar_2)",
        ),
        (
            "start_9.position",
            "start_9.position: unknown parameter, start_9 is not in sensors (radar_1, radar_2) or "
            "births (start_1, start_2, start_3, start_4)",
        ),
        (
            "radar_1.survival_probability",
            "radar_1.survival_probability: unknown parameter, survival_probability is a parameter "
            "of classes",
        ),
        ("radar_1.model", "radar_1.model: unknown parameter, model is a parameter of motions"),
        ("radar_1.speed", "radar_1.speed: unknown parameter"),
        ("radar_1.fov", "radar_1.fov: unknown parameter, did you mean radar_1.fov_deg?"),
        (
            "radar_1.fields.amp",
            "radar_1.fields.amp: unknown parameter, did you mean radar_1.fields.amplitude?",
        ),
        ("survival", "survival: unknown parameter"),
    ],
)
def test_resolve_suggests_the_parameter_that_is_meant(given, fault):
    assert faults_of({given: 1.0}) == [fault]


def test_resolve_looks_for_no_parameter_among_very_many():
    faults = faults_of({f"intervall_{k}": 1.0 for k in range(100)})
    assert faults[0] == "intervall_0: unknown parameter"
    assert len(faults) == 100


@pytest.mark.parametrize(
    ("given", "name", "words"),
    [
        ({"sensors": []}, "sensors", "at least one"),
        ({"sensors": ["a", "a"]}, "sensors", "distinct"),
        ({"sensors": ["a.b"]}, "sensors", "dot"),
        ({"sensors": ["lag"]}, "sensors", "is already a parameter"),
        ({"sensors": ["cv"]}, "motions", "is already one of sensors"),
        ({"class_0.snr_band_db": [30.0, 30.0]}, "class_0.snr_band_db", "larger"),
        # 1 + d is the same number at both ends, so the density would divide by ln 1.
        ({"class_0.snr_band_db": [-100.0, -99.9999999]}, "class_0.snr_band_db", "larger"),
        ({"class_0.motions": ["cv", "jump"]}, "class_0.motions", "must be among motions"),
        ({"class_0.motions": []}, "class_0.motions", "must be among motions"),
        ({"max_gap_scans": 1.0}, "max_gap_scans", "at least 2"),
        ({"reorder_s": 2e3}, "reorder_s", "at most 1000"),
        ({"reorder_s": -1.0}, "reorder_s", "at least 0"),
        ({"class_0.mode_transition": [1.0]}, "class_0.mode_transition", "2x2"),
        ({"class_0.mode_transition": [0.8, 0.2]}, "class_0.mode_transition", "2x2"),
        ({"class_0.mode_transition": [0.8, 0.3, 0.2, 0.8]}, "class_0.mode_transition", "sum to 1"),
        (
            {"class_0.mode_transition": [1.2, -0.2, 0.2, 0.8]},
            "class_0.mode_transition",
            "at most 1",
        ),
        ({"class_0.survival_probability": 0.0}, "class_0.survival_probability", "at least"),
        ({"particles": [0, 1000]}, "particles", "power of two"),
        ({"start_1.rates": [0.1]}, "start_1.rates", "2 numbers"),
        ({"start_1.rates": [0.0, 0.0]}, "start_1.rates", "not all 0"),
        ({"radar_1.topic": "/radar_2/detections"}, "radar_1.topic", "another sensor"),
        ({"radar_1.frame": "radar_2"}, "radar_2.frame", "another sensor"),
        ({"radar_3.range_std": 3.0}, "radar_3.range_std", "unknown"),
        ({"cv.model": "brownian"}, "cv.model", "coordinated_turn"),
        ({"radar_1.fov_deg": [10.0, 10.0]}, "radar_1.fov_deg", "two azimuths"),
        ({"radar_1.blind_sectors_deg": [10.0]}, "radar_1.blind_sectors_deg", "pairs"),
        ({"radar_1.min_range": 20e3}, "radar_1.min_range", "below max_range"),
        ({"radar_1.detection_probability": 1.0}, "radar_1.detection_probability", "to 0.999"),
        (
            {"radar_1.detection_probability": [0.9, 0.8]},
            "radar_1.detection_probability_range",
            "must be a range for each of 2 probabilities",
        ),
        (
            {"radar_1.detection_probability_range": [1e3, 500.0]},
            "radar_1.detection_probability_range",
            "must be ascending",
        ),
        (
            {"radar_1.detection_probability": [0.9, 0.8, 0.0]},
            "radar_1.detection_probability",
            "above 0 and at most 0.999",
        ),
        (
            {"radar_1.fields.range_rate": "rr", "radar_1.range_rate_ambiguity": 0.2},
            "radar_1.range_rate_ambiguity",
            "0 or at least 4 times",
        ),
        ({"radar_1.fields.range_rate_std": "sd"}, "radar_1.fields.range_rate", "must be a name"),
        ({"radar_1.sectors": 8}, "radar_1.rotation_s", "above 0 with sectors"),
        ({"radar_1.fields.sector": "sector"}, "radar_1.sectors", "above 0 with fields.sector"),
    ],
)
def test_resolve_refuses(given, name, words):
    about = [fault for fault in faults_of(given) if fault.startswith(name + ": ")]
    assert len(about) == 1
    assert words in about[0]


@pytest.mark.parametrize(
    ("given", "lag"),
    [
        ({}, Lag(5)),
        ({"lag": 2.0}, Lag(2)),
        ({"lag": 0}, Lag(0)),
        ({"lag": 2, "lag_s": 0.5}, Lag(0, 0.5)),
    ],
)
def test_the_lag_is_of_scans_or_of_seconds(given, lag):
    assert reference.resolve(given).lag == lag


@pytest.mark.parametrize("given", ["", "x", -1, 101, 1.5, 3.0000001, True, [5]])
def test_resolve_refuses_what_is_no_lag(given):
    (fault,) = faults_of({"lag": given})
    assert fault == f"lag: {given!r} given, must be a whole number, at least 0, at most 100"


def test_no_parameter_of_before_is_one_of_now():
    assert not {*schema({})} & {*replaced.TRACKER, *replaced.NODE}
    assert not {member.name for member in GROUPS["sensors"]} & {*replaced.RADAR}


@pytest.mark.parametrize(
    ("accuracy", "hypotheses", "particles"),
    [("fast", 8, 1500), ("normal", 8, 1500), ("high", 16, 3000)],
)
def test_accuracy_sets_hypotheses_and_particles(accuracy, hypotheses, particles):
    config = reference.resolve({"accuracy": accuracy})
    assert (config.bounds.hypotheses, config.budget.per_target) == (hypotheses, particles)
    assert reference.resolve({"accuracy": accuracy, "particles": [77]}).budget.per_target == 77


def test_grouper_and_engine_carry_the_configuration():
    given = {"interval_s": 4.0, "max_gap_scans": 10, "reorder_s": 1.5, "sensors": ["a", "b", "c"]}
    grouper = reference.resolve(given).grouper()
    assert (grouper.radars, grouper.reset_threshold_s) == (3, 12.0)
    assert (grouper.max_gap_s, grouper.reorder_s) == (40.0, 1.5)
    usual = reference.resolve({}).grouper()
    assert (usual.max_gap_s, usual.reorder_s) == (90.0, 0.0)
    resolved = reference.resolve({"engine": "phd_as_printed", "seed": 9})
    engine = new_engine(resolved)
    assert engine.recursion.death_term.__name__ == "printed_death_term"
    assert engine.recursion.extraction.__name__ == "clusters"
    assert engine.recursion.seed == 9


@pytest.mark.parametrize("engine", PHD)
@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"late_reports": "rework"}, "late_reports: rework given, must be drop"),
        ({"estimates_period_s": 2.0}, "estimates_period_s: 2.0 given, must be 0.0"),
        (
            {"detection_births.rates": [0.1, 0.1]},
            "detection_births.rates: [0.1, 0.1] given, must be []",
        ),
        ({"amplitude": "memory"}, "amplitude: memory given, must be auto or band or none"),
        ({"radar_1.rotation_s": 4.0}, "radar_1.rotation_s: 4.0 given, must be 0"),
        ({"radar_1.clutter_map": True}, "radar_1.clutter_map: true given, must be false"),
        (
            {"radar_1.clutter_amplitude": "learned"},
            "radar_1.clutter_amplitude: learned given, must be rayleigh",
        ),
        (
            {"radar_1.detection_correlation": 0.5},
            "radar_1.detection_correlation: 0.5 given, must be 0",
        ),
        *(
            ({"radar_1.learn": [word]}, f"radar_1.learn: ['{word}'] given, must be []")
            for word in LEARNED
        ),
        *(
            ({f"radar_1.fields.{name}": "own"}, f"radar_1.fields.{name}: 'own' given, must be ''")
            for name in (
                "time",
                "height",
                "elevation",
                "code",
                "address",
                "detection_type",
                "range_rate",
            )
        ),
    ],
)
def test_resolve_refuses_what_the_paper_does_not_have(given, fault, engine):
    assert faults_of({"engine": engine, **given}) == [f"{fault} with engine {engine}"]
    assert reference.resolve(given).inputs  # The default engine has it


def test_resolve_refuses_clutter_beyond_the_range_that_is_tracked():
    assert reference.resolve({"radar_1.clutter_max_range": 17e3}).inputs
    with pytest.raises(ConfigError) as caught:
        reference.resolve({"radar_1.max_range": 200.0})
    assert caught.value.faults == (
        "radar_1.clutter_max_range: 15000 given, must be at most max_range, 200, beyond which "
        "detections are ignored",
    )


def test_resolve_refuses_one_field_for_two_quantities():
    with pytest.raises(ConfigError) as caught:
        reference.resolve(
            {"radar_1.fields.azimuth": "range", "radar_2.fields.elevation": "amplitude"}
        )
    assert caught.value.faults == (
        "radar_1.fields.azimuth: 'range' given, radar_1.fields.range has it too",
        "radar_2.fields.amplitude: 'amplitude' given, radar_2.fields.elevation has it too",
    )
    # They are not used for a message whose definition fixes its fields.
    assert reference.resolve(
        {"radar_1.message": "radar_scan", "radar_1.fields.azimuth": "range"}
    ).inputs


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, 0.0),
        ({"radar_1.rotation_s": 4.0}, 1.0),
        ({"radar_1.rotation_s": 4.0, "radar_1.sectors": 16}, 0.5),
        ({"radar_1.rotation_s": 4.0, "radar_2.rotation_s": 4.8, "reorder_s": 4.8}, 6.0),
        ({"radar_1.rotation_s": 4.0, "radar_1.fields.time": "t"}, 7.0),
        # A scan that is reprocessed waits for nobody.
        ({"radar_1.rotation_s": 4.0, "radar_1.fields.time": "t", "late_reports": "rework"}, 1.0),
    ],
)
def test_answers_of_turning_radars_are_older_than_their_reports(given, expected):
    assert reference.resolve(given).answer_delay_s == pytest.approx(expected)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            {"radar_1.pose": "tf"},
            "radar_1.position: [1000.0, 0.0] with yaw_deg 0 given, must be 0 with pose tf, which "
            "places the radar",
        ),
        (
            {"radar_1.pose": "tf orientation"},
            "radar_1.pose: 'tf orientation' given, must be fixed, tf, or the topic of the "
            "platform's poses in the world frame",
        ),
        ({"radar_1.pose": ""}, "radar_1.pose: '' given, must be fixed, tf, or the topic"),
        ({"radar_1.pose": "Fixed"}, "radar_1.pose: 'Fixed' given, must be fixed, tf, or the topic"),
        ({"radar_1.pose": "/tf"}, "radar_1.pose: '/tf' given, must be fixed, tf, or the topic"),
        (
            {"radar_1.pose": "/radar_2/detections"},
            "radar_1.pose: '/radar_2/detections' given, radar_2 has its detections there",
        ),
        (
            {
                "radar_1.pose": "/a",
                "radar_2.pose": "/b",
                "radar_2.pose_message": "pose_stamped",
            },
            "radar_2.pose: pose_stamped given, must be odometry as that of radar_1",
        ),
    ],
)
def test_resolve_lists_what_a_radars_pose_may_be(given, expected):
    (fault,) = faults_of(given)
    assert fault.startswith(expected)


@pytest.mark.parametrize("group", ["classes", "motions", "births", "sensors"])
@pytest.mark.parametrize("count", [300, 3000])
def test_resolve_refuses_too_many_names_at_once(group, count):
    begin_s = time.process_time()
    try:
        reference.resolve({group: [f"n{index}" for index in range(count)]})
        faults = ()
    except ConfigError as error:
        faults = error.faults
    assert time.process_time() - begin_s < 2.0
    # Births are cheap, and a grid of places may have hundreds.
    assert bool(faults) == ((group, count) != ("births", 300))
    assert all(", at most" in fault for fault in faults)


def test_resolve_takes_as_many_classes_as_there_may_be_each_with_its_own_matrix():
    names = [f"n{index}" for index in range(MOST_CLASSES)]
    given = {"classes": names, "births": [], "detection_births.rates": [0.01] * len(names)}
    for index, name in enumerate(names):
        stays = 0.95 - 0.005 * index
        given[f"{name}.mode_transition"] = [stays, 1.0 - stays, 1.0 - stays, stays]
    given |= {"spawn.rate": 0.0}
    assert len(reference.resolve(given).model.modes.classes) == MOST_CLASSES


SPACE = {"state": "space", "radar_1.fields.elevation": "elevation"}


def test_space_makes_radars_and_motions_with_heights():
    given = {**SPACE, "radar_1.position": [10.0, 0.0, 35.0], "height_prior": [800.0, 400.0, 20.0]}
    config = reference.resolve({**given, "ct.vertical_noise_density": 3.0})
    assert config.model.modes.space == SPATIAL
    assert {motion.vertical_noise_density for motion in config.model.modes.motions} == {1.0, 3.0}
    first, second = config.model.radars
    assert first.origin[0].tolist() == [10.0, 0.0, 35.0]
    assert first.noise_std[2] == pytest.approx(math.radians(1.0))
    # The other one measures slant ranges alone.
    assert second.elevation_std == UNKNOWN_STD
    assert first.height_prior == config.model.height_prior == HeightPrior(800.0, 400.0, 20.0)
    for birth in config.model.births:
        assert birth.mean[5:].tolist() == [800.0, 0.0]
        assert birth.std[5:].tolist() == [400.0, 5.0]
    flat = reference.resolve({"radar_1.fields.elevation": "elevation"}).model
    assert flat.modes.space == PLANAR
    assert flat.height_prior is None
    assert not isinstance(flat.radars[0], SpatialRadar)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"engine": "phd"}, "state: space given, must be plane with engine phd"),
        ({"height_prior": [0.0, 0.0, 0.0]}, "height_prior: [0.0, 0.0, 0.0] given, must be 2 or 3"),
        (
            {"height_prior": [0.0, 9.0, 30.0]},
            "height_prior: [0.0, 9.0, 30.0] given, must be 2 or 3",
        ),
        (
            {"radar_1.fov_elevation_deg": [10.0, -10.0]},
            "radar_1.fov_elevation_deg: [10.0, -10.0] given, the second must be larger",
        ),
        (
            {"radar_2.fields.elevation_std": "de"},
            "radar_2.fields.elevation: '' given, must be a name with elevation_std",
        ),
        (
            {"radar_1.clutter_map": True, "radar_1.pose": "/ship"},
            "radar_1.clutter_map: true given, must be false with a pose with state: space",
        ),
        (
            {"radar_1.tilt_deg": [5.0, 0.0], "state": "plane"},
            "radar_1.tilt_deg: [5.0, 0.0] given, must be [0.0, 0.0] without state: space",
        ),
        (
            {"radar_1.learn": ["multipath"]},
            "radar_1.learn: ['multipath'] given, must be without multipath",
        ),
        ({"radar_1.assumed_height": 500.0}, "radar_1.assumed_height: 500.0 given, must be empty"),
        ({"qnh_hpa": [29.92, 1.0]}, "qnh_hpa: [29.92, 1.0] given, must be empty or two numbers"),
    ],
)
def test_space_refuses_what_it_does_not_have(given, fault):
    assert any(found.startswith(fault) for found in faults_of({**SPACE, **given}))


def test_heights_in_space_are_pressure_altitudes_or_those_of_positions():
    given = {
        **SPACE,
        "radar_1.fields.height": "h",
        "qnh_hpa": [1003.25, 5.0],
        "radar_2.kind": "position",
    }
    known = {**reference.parameters(), **given}
    radar_2 = [name for name in known if name.startswith("radar_2.") and name not in given]
    config = build.resolve({name: known[name] for name in known.keys() - {*radar_2}})
    radar, lidar = config.model.radars
    assert radar.reported_heights == ReportedHeights(7.6, 0.01, pressure=True)
    assert lidar.reported_heights == ReportedHeights(0.5, 0.0)
    # 10 hPa below the standard pressure, pressure altitudes are larger by some 83 m.
    pressure = next(each for each in config.model.factors["radar_1"] if isinstance(each, Pressure))
    assert pressure.mean == pytest.approx(83.4, abs=0.5)
    assert pressure.std == pytest.approx(41.8, abs=0.5)
    assert not any(isinstance(each, Pressure) for each in config.model.factors["radar_2"])
    assert config.model.attributes is None
    assert reference.resolve({"radar_1.fields.height": "h"}).model.attributes is not None


def test_what_is_estimated_in_the_plane_is_refused_in_space():
    reference.resolve({}).require_plane("register")
    with pytest.raises(ConfigError, match="state: space given, must be plane"):
        reference.resolve(SPACE).require_plane("register")


def test_detections_of_a_site_are_placed_exactly_in_space():
    given = {
        **SPACE,
        "world_origin": [48.0, 11.0, 500.0],
        "radar_1.geodetic": [48.8, 11.9, 620.0],
        "radar_1.yaw_deg": 30.0,
        "radar_1.max_range": 400e3,
        "sensors": ["radar_1"],
    }
    config = reference.resolve(given, SystemPlane)
    (layout,), (model,) = config.radars, config.model.radars
    distance, azimuth = np.array([3e3, 90e3, 300e3]), np.array([0.4, -2.0, 1.5])
    elevation = np.array([0.6, 0.05, 0.005])
    place = layout.site.to_world(distance, azimuth, np.sin(elevation))
    place[:, 2] -= layout.datum
    # Refraction lets targets appear higher.
    seen = elevation + distance * layout.curvature / 8.0
    measured = ground_ranges.in_space(distance, azimuth, seen, layout)
    np.testing.assert_allclose(model.to_world(measured), place, atol=1e-2)
    assert np.abs(measured[:, 0] - distance).max() < 500.0
    unknown = ground_ranges.in_space(distance, azimuth, None, layout)
    assert np.isnan(unknown[:, 2]).all()
    assert np.abs(unknown[:, 0] - distance).max() < 500.0
