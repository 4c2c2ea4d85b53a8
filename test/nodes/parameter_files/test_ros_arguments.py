"""Faults of the ROS arguments and of parameter files: one line each, and exit status 2."""

import tempfile

import pytest
from live_radars import FAST

NODES = ("tracker", "evaluator", "sensor_replay")
ARGUMENTS = {
    "no value": (("-p", "foo"), "-p foo: must be -p NAME:=VALUE"),
    "empty value": (
        ("-p", "lag:="),
        "-p lag:=: must be -p NAME:=VALUE; the value is missing: an empty string is "
        """-p "NAME:=''\"""",
    ),
    "broken value": (("-p", "lag:=[1,"), "-p lag:=[1,: must be -p NAME:=VALUE"),
    "broken remap": (("-r", "foo"), "-r foo: must be -r FROM:=TO"),
    "log level": (("--log-level", "loud"), "--log-level loud: must be --log-level LEVEL or"),
    "no file": (("--params-file", "/nope.yaml"), "/nope.yaml: cannot be read: No such file or"),
    "no path": (("--params-file",), "Failed to parse ROS arguments: Couldn't parse trailing"),
}
SECTIONS = ("/s2/tracker", "tracker", "/evaluator", "sensor_replay")


@pytest.mark.parametrize("case", ARGUMENTS)
@pytest.mark.parametrize("name", NODES)
def test_fault_of_a_ros_argument_is_one_line(processes, name, case):
    words, expected = ARGUMENTS[case]
    status, text = processes.run(name, "--ros-args", *words)
    assert status == 2
    assert text.startswith(f"{name}: {expected}")
    assert len(text.splitlines()) == 1


LONG = [
    *(
        ("tracker", "--ros-args", *words)
        for words in (
            ("-p", f"lag:={'9' * 5000}"),
            ("-p", f"lag:={'a' * 5000}"),
            ("-p", f"{'a' * 5000}:=1"),
            ("-p", f"sensors:=[{'a' * 5000}, {'a' * 5000}]"),
            ("-p", f"radar_1.topic:={'a' * 5000}"),
            ("-r", f"__node:={'a' * 5000}"),
            ("-r", "a" * 5000),
            ("--params-file", "a" * 5000),
        )
    ),
    ("tracker", "a" * 5000),
    ("evaluator", "--ros-args", "-p", f"cutoff:={'9' * 5000}"),
    ("sensor_replay", "a" * 5000),
    ("sensor_replay", "bag", "--rate", "a" * 5000),
]


@pytest.mark.parametrize("words", LONG, ids=lambda words: " ".join(w[:12] for w in words))
def test_long_values_are_quoted_in_part(processes, words):
    status, text = processes.run(*words)
    assert status == 2
    assert max(map(len, text.splitlines())) < 600
    assert text.splitlines()[-1].startswith(f"{words[0]}: ")


FILES = {
    "broken": ("{name}:\n  ros__parameters:\n    lag: [1,\n", "is not YAML: "),
    "no parameters": (
        "{name}:\n  ros_parameters:\n    sensors: [a, b]\n",
        "has no ros__parameters under a node's name\n",
    ),
    "twice": (
        "{name}:\n  ros__parameters:\n    lag: 1\n    lag: 2\n",
        "line 4: lag is given twice, first in line 3\n",
    ),
}


@pytest.mark.parametrize("case", FILES)
@pytest.mark.parametrize("name", NODES)
def test_fault_of_a_parameter_file_is_one_line(processes, tmp_path, name, case):
    path, (content, fault) = tmp_path / "p.yaml", FILES[case]
    path.write_text(content.format(name=name))
    status, text = processes.run(name, "--ros-args", "--params-file", path)
    assert status == 2
    assert text.startswith(f"{name}: {path}: {fault}")
    assert len(text.splitlines()) == 1


@pytest.mark.parametrize("name", NODES)
def test_file_without_a_section_for_the_node_ends_it(processes, tmp_path, name):
    path = tmp_path / "site.yaml"
    path.write_text("".join(f"{s}: {{ros__parameters: {{lag: 2}}}}\n" for s in SECTIONS))
    status, text = processes.run(name, "--ros-args", "-r", "__ns:=/s1", "--params-file", path)
    assert (status, text) == (
        2,
        f"{name}: {path}: has no section for this node, /s1/{name}; "
        "it has /s2/tracker, /tracker, /evaluator, /sensor_replay\n",
    )


CLOCK = "/**: {ros__parameters: {use_sim_time: true}}\n"


@pytest.mark.parametrize("renamed", ["__ns:=/north", "__node:=t2"])
@pytest.mark.parametrize("by_launch", [False, True])
def test_file_of_another_name_beside_a_clock_for_all_ends_the_node(
    processes, tmp_path, renamed, by_launch
):
    path, name = tmp_path / "site.yaml", {"__node:=t2": "/t2"}.get(renamed, "/north/evaluator")
    path.write_text(f"{CLOCK}/evaluator: {{ros__parameters: {{cutoff: 2.0}}}}\n")
    with tempfile.NamedTemporaryFile("w", prefix="launch_params_") as file:
        file.write(f"{name}: {{ros__parameters: {{order: 1.0}}}}\n")
        file.flush()
        words = ("--params-file", file.name) if by_launch else ()
        status, text = processes.run(
            "evaluator", "--ros-args", "-r", renamed, "--params-file", path, *words
        )
    assert (status, text) == (
        2,
        f"evaluator: {path}: has no section for this node, {name}; "
        "it has /** (only use_sim_time), /evaluator\n",
    )


def test_file_for_other_nodes_is_logged_beside_one_for_the_node(processes, peer, tmp_path):
    path, good = tmp_path / "north.yaml", tmp_path / "good.yaml"
    path.write_text("/**/tracker: {ros__parameters: {lag: 2}}\n")
    good.write_text("/**: {ros__parameters: {lag: 3, particles: [100]}}\n")
    files = ("--params-file", good, "--params-file", path)
    tracker = processes.start("tracker", "--ros-args", "-r", "__node:=t2", *files, *FAST)
    text = peer.said(tracker, "tracking ")
    assert f"{path}: has no section for this node, /t2; it has /**/tracker; it is not used" in text
    assert f"parameters from {good}\n" in text


@pytest.mark.parametrize("section", ["/**", "/*/tracker", "/s1/tracker", "s1/tracker"])
def test_file_with_a_section_for_the_tracker_is_named(processes, peer, tmp_path, section):
    path = tmp_path / "site.yaml"
    path.write_text(
        f"{section}:\n  ros__parameters:\n    sensors: [north]\n"
        "    north: {topic: plots, max_range: 1e4, clutter_max_range: 1e4}\n"
        "    particles: [100]\n"
    )
    tracker = processes.start(
        "tracker", "--ros-args", "-r", "__ns:=/s1", "--params-file", path, *FAST
    )
    text = peer.said(tracker, "tracking ")
    assert (
        "tracking 2 classes (class_0, class_1) with 1 radar (north on /s1/plots), "
        f"parameters from {path}\n"
    ) in text


@pytest.mark.parametrize("given", [(), ("-p", "lag:=2", "-p", "use_sim_time:=false")])
def test_tracker_without_a_file_logs_that_it_uses_the_defaults(processes, peer, given):
    tracker = processes.start("tracker", "--ros-args", *given)
    (line,) = [row for row in peer.said(tracker, "tracking ").splitlines() if "tracking " in row]
    assert line.endswith(
        "tracking 2 classes (class_0, class_1) with 2 radars (radar_1 on /radar_1/detections, "
        "radar_2 on /radar_2/detections), default parameters (profile defaults)"
        + (" except lag" if given else "")
        + ": no parameter file sets any; for radars of your own start from a copy of "
        "config/surveillance.yaml"
    )


def test_tracker_by_the_defaults_does_not_take_a_file_of_launch_for_the_users(processes, peer):
    """launch writes a temporary file of what a launch file sets by itself."""
    with tempfile.NamedTemporaryFile("w", prefix="launch_params_") as file:
        file.write("/tracker: {ros__parameters: {autostart: true, use_sim_time: false}}")
        file.flush()
        tracker = processes.start("tracker", "--ros-args", "--params-file", file.name)
        text = peer.said(tracker, "tracking ")
    assert "default parameters (profile defaults) except autostart: no parameter file" in text
