"""What the demo's tracker and evaluator are given, by profile and bag."""

import pytest
import reference

from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.exit_status import FAILED
from phd_jdtc_ros.nodes.evaluator import least_speed
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.resources import bag
from phd_jdtc_ros.tools.demo import asterix, demo, processes


@pytest.fixture
def given(monkeypatch, tmp_path):
    """Return a function that returns the configuration and c that a demo gives to its nodes."""
    seen = []

    def run_nodes(bag, config, out, logs, cutoff):
        seen.append((config, cutoff))
        return False

    def start(*arguments):
        monkeypatch.setattr(demo, "run_nodes", run_nodes)
        assert demo.main([*arguments, "--out", str(tmp_path / "out")]) == FAILED
        return seen.pop()

    return start


def test_radars_of_a_profile_are_where_the_bag_has_them(given, capsys):
    config, _ = given("--profile", "marine", "--bag", "coastal_ship")
    expected = from_arguments.config_of(bag_parameters.read(bag("coastal_ship")))
    assert scene.other_places(expected.values, config.values) == {}
    assert list(config.radars_by_platform) == ["/own_ship/odometry"]
    said = capsys.readouterr().err
    assert said.startswith("demo: mast.position, mast.yaw_deg, mast.pose as in ")
    assert "recorded" not in said


def test_assignments_override_where_the_bag_has_a_radar(given):
    words = "--profile", "marine", "--bag", "coastal_ship", "-p", "mast.position:=[1.0, 2.0]"
    config, _ = given(*words)
    assert config.values["mast.position"] == [1.0, 2.0]
    assert config.values["mast.pose"] == "/own_ship/odometry"


@pytest.mark.parametrize(
    ("words", "cutoff"),
    [
        ((), 1000.0),
        (("--bag", "autoferry_2"), 50.0),
        (("--bag", "coastal_ship"), 200.0),
        (("--profile", "marine"), 200.0),
        (("--profile", "air_traffic", "--bag", "terminal_radar"), 1000.0),
        (("--profile", "marine", "--bag", str(bag("coastal_ship"))), 200.0),
        (("--bag", "automotive", "--cutoff", "30"), 30.0),
    ],
)
def test_cutoff_is_that_of_the_bag_unless_it_is_given(given, words, cutoff):
    assert given(*words)[1] == cutoff


@pytest.mark.parametrize(
    ("words", "folder"),
    [
        ((), "demo"),
        (("--bag", str(bag("paper_scenario").resolve())), "demo"),
        (("--engine", "gaussian"), "demo_gaussian"),
        (("--bag", "three_classes"), "demo_three_classes"),
        (("--bag", str(bag("three_classes").resolve())), "demo_three_classes"),
        (("--profile", "air_traffic"), "demo_air_traffic"),
        (("--profile", "air_traffic", "--bag", "two_approach_radars"), "demo_air_traffic"),
        (
            ("--profile", "air_traffic", "--bag", "terminal_radar"),
            "demo_air_traffic_terminal_radar",
        ),
        (
            ("--profile", "phd", "--bag", "one_radar", "--engine", "phd"),
            "demo_phd_one_radar_phd",
        ),
    ],
)
def test_demo_writes_into_a_folder_of_profile_bag_and_engine(monkeypatch, tmp_path, words, folder):
    seen = []

    def run_nodes(bag, config, out, logs, cutoff):
        seen.append(logs.parent)
        return False

    for module in (demo, asterix):
        monkeypatch.setattr(module, "run_nodes", run_nodes)
    monkeypatch.chdir(tmp_path)

    assert demo.main(words) == FAILED
    assert [path.as_posix() for path in seen] == [f"out/{folder}"]


@pytest.mark.parametrize(
    ("words", "speed"),
    [
        (("--profile", "marine"), 2.5),
        (("--profile", "marine", "-p", "mast.clutter_map:=false"), 0.0),
        (("--profile", "marine", "-p", "mast.clutter_map_speed:=0.0"), 0.0),
        (("--profile", "automotive"), 0.0),
    ],
)
def test_targets_taken_for_clutter_are_not_scored(given, words, speed):
    config, _ = given(*words)
    assert least_speed(config.values) == config.least_speed == speed


def test_poses_of_a_radar_that_moves_are_recorded_with_its_detections(given, tmp_path):
    config, cutoff = given("--bag", "autoferry_2")
    found = processes.evaluator_parameters(bag("autoferry_2"), config, tmp_path, cutoff)
    (radar,) = config.inputs
    assert found["record_topics"] == f"[{radar.topic}, /own_ship/odometry]"
    assert found["record_types"] == "[cloud, odometry]"


@pytest.mark.parametrize(
    ("given", "engines"),
    [
        ({"engine": "gaussian"}, ["phd_as_printed", "phd"]),
        ({"engine": "phd"}, ["phd_as_printed"]),
        # They are born at given places only.
        ({"detection_births.rates": [0.1, 0.1]}, []),
    ],
)
def test_demo_compares_the_papers_filters_that_can_track_the_bag(given, engines):
    assert [each.engine for each in demo.papers_filters(reference.resolve(given))] == engines
