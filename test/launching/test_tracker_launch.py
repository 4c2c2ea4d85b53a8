"""The tracker's launch file, run with executables that only print how they were started."""

import itertools
import json
import os
import sys
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_share_directory

launch = pytest.importorskip("launch", reason="launch is not installed")
actions = pytest.importorskip("launch.actions", reason="launch is not installed")
sources = pytest.importorskip("launch.launch_description_sources")
ros_actions = pytest.importorskip("launch_ros.actions", reason="launch_ros is not installed")

try:
    SHARE = Path(get_package_share_directory("phd_jdtc_ros"))
except LookupError:
    pytest.skip("the package is not built with colcon", allow_module_level=True)

EXECUTABLES = {"phd_jdtc_ros": "tracker", "rviz2": "rviz2"}
MINE = """
/**/tracker:
  ros__parameters:
    use_sim_time: false
    outputs: [paths]
    qos_overrides: {/north/points: {subscription: {reliability: reliable}}}
    sensors: [north]
    north: {topic: /north/points, frame: north_link}
"""
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def parameters(arguments):
    """Return the parameters that launch writes into files of its own."""
    values = {}
    for word, path in itertools.pairwise(arguments):
        if word == "--params-file":
            for section in yaml.safe_load(Path(path).read_text()).values():
                values |= section["ros__parameters"]
    return values


@pytest.fixture
def printed(tmp_path, monkeypatch):
    """Return a function that launches the file and returns how it started what it started."""
    prefix = tmp_path / "prefix"
    notes = tmp_path / "notes"
    notes.mkdir()
    for name in PROFILE_VARIABLES:
        # Set first, or what launch sets in this very process would outlive the test.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)

    ends_with = [0]

    def install(package, executable):
        marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
        script = prefix / "lib" / package / executable
        script.parent.mkdir(parents=True)
        script.write_text(
            f"#!{sys.executable}\nimport json, os, sys\n"
            f"with open(f'{notes}/{executable}_{{os.getpid()}}', 'w') as file:\n"
            "    json.dump({'arguments': sys.argv[1:], 'environment': dict(os.environ)}, file)\n"
            f"sys.exit({ends_with[0]})\n"
        )
        script.chmod(0o755)

    def run(packages, status=0, pushed=None, **arguments):
        ends_with[0] = arguments.pop("ends_with", 0)
        for package in packages:
            install(package, EXECUTABLES[package])
        # The package's own files, under the prefix of the test.
        (prefix / "share" / "phd_jdtc_ros").symlink_to(SHARE)
        monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}")
        path = str(SHARE / "launch" / "tracker.launch.py")
        service = launch.LaunchService()
        included = actions.IncludeLaunchDescription(
            sources.PythonLaunchDescriptionSource(path),
            launch_arguments={"respawn": "false", **arguments}.items(),
        )
        first = [ros_actions.PushRosNamespace(pushed)] if pushed else []
        service.include_launch_description(launch.LaunchDescription([*first, included]))
        assert service.run() == status
        return {
            executable: [
                json.loads(file.read_text()) for file in sorted(notes.glob(f"{executable}_*"))
            ]
            for executable in EXECUTABLES.values()
        }

    return run


def test_the_tracker_gets_its_parameters_and_its_name(printed):
    found = printed(["phd_jdtc_ros"], namespace="alpha", use_sim_time="true")
    (started,) = found["tracker"]
    arguments = started["arguments"]
    assert "__node:=tracker" in arguments
    assert "__ns:=/alpha" in arguments
    assert not any(entry.endswith("defaults.yaml") for entry in arguments)
    assert found["rviz2"] == []


def test_rviz_shows_the_tracker_of_the_namespace(printed):
    found = printed(["phd_jdtc_ros", "rviz2"], namespace="alpha", rviz="true")
    (started,) = found["rviz2"]
    assert any(entry.endswith("rviz/demo.rviz") for entry in started["arguments"])
    for topic in ("detections", "filtered/estimates", "smoothed/estimates", "markers"):
        assert f"/tracker/{topic}:=/alpha/tracker/{topic}" in started["arguments"]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("", None),
        ("false", ["detections", "markers", "curves"]),
        ("True", ["detections", "markers", "curves", "frames"]),
    ],
)
def test_frames_are_published_by_the_tracker_alone_as_asked(printed, given, expected):
    (started,) = printed([*EXECUTABLES], frames=given)["tracker"]
    assert parameters(started["arguments"]).get("outputs") == expected


def test_parameters_of_the_node_alone_are_no_obstacle(printed, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(MINE)
    found = printed([*EXECUTABLES], params_file=str(path), rviz="true")
    assert len(found["tracker"]) == 1
    (rviz,) = found["rviz2"]
    # The radars' own topics are not shown, whatever their names.
    assert not [word for word in rviz["arguments"] if ":=/north" in word]


def test_dds_stays_as_it_is_unless_asked(printed):
    (started,) = printed(["phd_jdtc_ros"])["tracker"]
    assert not {*PROFILE_VARIABLES} & {*started["environment"]}


def test_all_that_is_started_keeps_to_this_machine_if_asked(printed):
    found = printed([*EXECUTABLES], localhost_only="true", rviz="true")
    profile = SHARE / "config" / "dds" / "localhost_only.xml"
    processes = [started["environment"] for name in found for started in found[name]]
    assert len(processes) == 2
    for environment in processes:
        for name in PROFILE_VARIABLES:
            assert Path(environment[name]).samefile(profile)


def test_a_dds_profile_of_the_users_stays_in_force(printed, monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLES[0], "/etc/site.xml")
    (started,) = printed(["phd_jdtc_ros"], localhost_only="true")["tracker"]
    assert started["environment"][PROFILE_VARIABLES[0]] == "/etc/site.xml"
    assert PROFILE_VARIABLES[1] not in started["environment"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"params_file": "/nope.yaml", "frames": "false"},
        {"rviz": "yes"},
        {"respawn": "TRUE"},
        {"autostart": "2"},
        {"respawn_max_retries": "-1"},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_nothing_is_started_with_a_wrong_argument(printed, wrong):
    found = printed([*EXECUTABLES], status=1, **wrong)
    assert not any(found.values())


@pytest.mark.parametrize("text", ["tracker: {ros__parameters: {lag: 2}}", MINE + "    lak: 2\n"])
def test_nothing_is_started_with_a_file_that_the_tracker_refuses(printed, tmp_path, text):
    path = tmp_path / "site.yaml"
    path.write_text(text)
    found = printed([*EXECUTABLES], status=1, params_file=str(path), namespace="s1")
    assert not any(found.values())


def test_pushed_namespace_reaches_rviz_and_the_file(printed, tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("/site/alpha/t2: {ros__parameters: {lag: 2}}")
    found = printed(
        ["phd_jdtc_ros", "rviz2"],
        pushed="site",
        namespace="alpha",
        node_name="t2",
        params_file=str(path),
        rviz="true",
    )
    (tracker,), (rviz,) = found["tracker"], found["rviz2"]
    assert {"__node:=t2", "__ns:=/site/alpha"} <= {*tracker["arguments"]}
    assert "/tracker/markers:=/site/alpha/t2/markers" in rviz["arguments"]


def test_log_level_and_enclave_reach_the_tracker(printed):
    (started,) = printed(["phd_jdtc_ros"], log_level="debug", enclave="/s1")["tracker"]
    words = " ".join(started["arguments"])
    assert "--log-level debug" in words
    assert "--enclave /s1" in words


@pytest.mark.parametrize(
    ("ends_with", "respawn", "starts"), [(2, "True", 1), (1, "True", 2), (1, "false", 1)]
)
def test_a_tracker_that_stays_dead_ends_the_launch_with_1(printed, ends_with, respawn, starts):
    """Respawn is bounded, and of no use after status 2."""
    found = printed(
        ["phd_jdtc_ros"], status=1, respawn=respawn, respawn_max_retries="1", ends_with=ends_with
    )
    assert len(found["tracker"]) == starts


def test_a_tracker_that_ends_well_ends_the_launch_with_status_0(printed):
    found = printed(["phd_jdtc_ros"], status=0, respawn="true", respawn_max_retries="1")
    assert len(found["tracker"]) == 2
