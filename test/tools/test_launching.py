"""What the launch files work out; `test/launching` runs them where launch is installed."""

import ast
from importlib.util import find_spec
from pathlib import Path

import pytest
from refusals import faults_of

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.exit_status import CORRUPT, FAILED, OK, USAGE
from phd_jdtc_ros.parameter_files import node_tables
from phd_jdtc_ros.tools.launching import arguments

ROOT = Path(__file__).parents[2]


def test_booleans_follow_one_rule_and_list_every_fault():
    given = {"a": "true", "b": "True", "c": "1", "d": "false", "e": "False", "f": "0"}
    assert arguments.booleans(given) == {name: name in "abc" for name in given}
    assert faults_of(arguments.booleans, {"rviz": "yes", "frames": "1", "respawn": ""}) == [
        "rviz: 'yes' given, must be one of true, True, 1, false, False, 0",
        "respawn: '' given, must be one of true, True, 1, false, False, 0",
    ]


@pytest.mark.parametrize("text", ["", "-1", "2.5", "many", "9" * 5000])
def test_whole_refuses_what_is_none(text):
    assert arguments.whole("retries", "10") == 10
    assert len(faults_of(arguments.whole, "retries", text)) == 1


@pytest.mark.parametrize(
    ("pushed", "given", "tracker"),
    [
        (None, "", "/tracker"),
        (None, "s1", "/s1/tracker"),
        (None, "/s1/", "/s1/tracker"),
        ("/site", "", "/site/tracker"),
        ("/site", "s1", "/site/s1/tracker"),
        ("/site", "/s1", "/s1/tracker"),
        ("/site", "/", "/tracker"),
        ("/", "a/b", "/a/b/tracker"),
    ],
)
def test_names_are_those_of_the_group_that_the_launch_file_is_in(pushed, given, tracker):
    assert arguments.full_name(arguments.full_namespace(pushed, given), "tracker") == tracker


def test_load_takes_the_file_for_the_tracker_alone(tmp_path):
    path = tmp_path / "site.yaml"
    clock = "/**: {ros__parameters: {use_sim_time: true}}\n"
    path.write_text(f"{clock}/s1/tracker: {{ros__parameters: {{lag: 2, max_wait_s: 9.0}}}}\n")
    assert arguments.load(str(path), "/s1/tracker").lag.scans == 2
    assert faults_of(arguments.load, str(path), "/tracker") == [
        f"{path}: has no section for this node, /tracker; it has /** (only use_sim_time), "
        "/s1/tracker"
    ]
    assert arguments.load("", "/tracker").lag.scans == 5


@pytest.mark.parametrize(
    ("status", "ends", "final"),
    [
        (OK, 9, False),
        (FAILED, 2, False),
        (FAILED, 3, True),
        (CORRUPT, 1, False),
        (-9, 3, True),
        (USAGE, 1, True),
    ],
)
def test_tracker_is_given_up_after_all_retries_or_a_fault_of_its_arguments(status, ends, final):
    assert arguments.is_final(status, ends, retries=2) is final


@pytest.mark.parametrize("text", ["-1", "0.05", "nan", "fast", "", "1001"])
def test_rate_refuses_what_the_replay_would_refuse(text):
    assert [node_tables.rate(good) for good in ("0", "0.1", "2")] == [0.0, 0.1, 2.0]
    (fault,) = faults_of(node_tables.rate, text)
    assert fault.startswith("rate: ")


def test_demo_of_a_shipped_bag_has_its_parameters_for_the_tracker_of_that_name(tmp_path):
    bag, params_file, config = arguments.demo("three_classes", "", "/s1/t2", tmp_path / "out")
    assert bag.samefile(ROOT / "bags" / "three_classes")
    assert [kind.name for kind in config.model.modes.classes] == ["weak", "medium", "strong"]
    assert arguments.load(params_file, "/s1/t2").values == config.values


def test_demo_takes_a_file_of_its_own_or_the_defaults(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("/tracker: {ros__parameters: {lag: 2}}\n")
    _, params_file, config = arguments.demo(
        "three_classes", str(path), "/tracker", tmp_path / "out"
    )
    assert (params_file, config.lag.scans) == (str(path), 2)
    assert not (tmp_path / "out").exists()
    bag, params_file, config = arguments.demo(str(tmp_path), "", "/tracker", tmp_path / "out")
    assert (bag, params_file) == (tmp_path, "")
    assert config.values == resolve({}).values


@pytest.mark.parametrize("name", ["demo", "tracker"])
def test_launch_files_import_names_that_exist(name):
    tree = ast.parse((ROOT / "launch" / f"{name}.launch.py").read_text())
    own = [n for n in tree.body if isinstance(n, ast.ImportFrom) and "phd_jdtc" in (n.module or "")]
    assert own
    for statement in own:
        # The module is read and not imported, because launch may not be installed.
        spec = find_spec(statement.module)
        source = Path(spec.origin).read_text()
        defined = {getattr(node, "name", None) for node in ast.parse(source).body}
        for alias in statement.names:
            folder = Path(spec.origin).parent
            is_module = (folder / f"{alias.name}.py").exists() and spec.submodule_search_locations
            assert alias.name in defined or is_module, f"{statement.module}.{alias.name}"
