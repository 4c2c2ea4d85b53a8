"""What the launch files work out; `test/launching` runs them where launch is installed."""

from pathlib import Path

import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import CORRUPT, FAILED, OK, USAGE
from phd_jdtc_ros.tools import launching

ROOT = Path(__file__).parents[2]


def faults(function, *arguments):
    with pytest.raises(ConfigError) as caught:
        function(*arguments)
    return list(caught.value.faults)


def test_booleans_follow_one_rule():
    given = {"a": "true", "b": "True", "c": "1", "d": "false", "e": "False", "f": "0"}
    assert launching.booleans(given) == {name: name in "abc" for name in given}


def test_booleans_lists_every_fault():
    assert faults(launching.booleans, {"rviz": "yes", "frames": "1", "respawn": ""}) == [
        "rviz: 'yes' given, must be one of true, True, 1, false, False, 0",
        "respawn: '' given, must be one of true, True, 1, false, False, 0",
    ]


@pytest.mark.parametrize("text", ["", "-1", "2.5", "many", "9" * 5000])
def test_whole_refuses_what_is_none(text):
    assert launching.whole("retries", "10") == 10
    assert len(faults(launching.whole, "retries", text)) == 1


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
    assert launching.full_name(launching.full_namespace(pushed, given), "tracker") == tracker


def test_load_takes_the_file_for_the_tracker_alone(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("/s1/tracker: {ros__parameters: {lag: 2, max_wait_s: 9.0}}\n")

    assert launching.load(str(path), "/s1/tracker").lag.scans == 2
    assert faults(launching.load, str(path), "/tracker") == [
        f"{path}: has no section for this node, /tracker; it has /s1/tracker"
    ]
    assert launching.load("", "/tracker").lag.scans == 5


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
    assert launching.is_final(status, ends, retries=2) is final


@pytest.mark.parametrize("path", sorted((ROOT / "launch").glob("*.py")), ids=lambda path: path.stem)
def test_launch_files_compile(path):
    compile(path.read_text(), str(path), "exec")


@pytest.mark.parametrize("text", ["-1", "0.05", "nan", "fast", "", "1001"])
def test_rate_refuses_what_the_replay_would_refuse(text):
    assert [launching.rate(good) for good in ("0", "0.1", "2")] == [0.0, 0.1, 2.0]
    (fault,) = faults(launching.rate, text)
    assert fault.startswith("rate: ")


def test_demo_of_a_shipped_bag_has_its_parameters_for_the_tracker_of_that_name(tmp_path):
    found = launching.demo("three_classes", "", "/s1/t2", tmp_path / "out")

    assert found.bag.samefile(ROOT / "bags" / "three_classes")
    assert [kind.name for kind in found.config.model.modes.classes] == ["weak", "medium", "strong"]
    assert launching.load(found.params_file, "/s1/t2").values == found.config.values


def test_demo_with_a_file_of_its_own_takes_that(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("/tracker: {ros__parameters: {lag: 2}}\n")
    found = launching.demo("three_classes", str(path), "/tracker", tmp_path / "out")

    assert (found.params_file, found.config.lag.scans) == (str(path), 2)
    assert not (tmp_path / "out").exists()


def test_demo_of_a_bag_without_parameters_has_the_defaults(tmp_path):
    found = launching.demo(str(tmp_path), "", "/tracker", tmp_path / "out")

    assert (found.bag, found.params_file) == (tmp_path, "")
    assert found.config.values == resolve({}).values
