"""Every node starts with a clear answer to bad input and stops cleanly on a signal."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

BAG = Path(__file__).parents[3] / "bags" / "paper_scenario"
NODES = {
    "tracker": (),
    "evaluator": (),
    "sensor_replay": (BAG, "--rate", "1", "--ros-args", "-p", "subscriber_timeout_s:=0.0"),
}


def logging(process, text):
    """Wait until a process has logged a text, without a look at anything else."""
    end = time.monotonic() + 20.0
    while text not in process.log.read_text() and time.monotonic() < end:
        time.sleep(0.001)


@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize("signals", [(signal.SIGINT,), (signal.SIGTERM,), (signal.SIGINT,) * 2])
def test_node_stops_cleanly_on_a_signal(processes, name, signals):
    process = processes.start(name, *NODES[name])
    logging(process, "[")
    for number in signals:
        process.send_signal(number)
        time.sleep(0.05)
    assert process.wait(30.0) == 0
    assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize(
    ("name", "number"),
    [("tracker", signal.SIGINT), ("evaluator", signal.SIGTERM), ("sensor_replay", signal.SIGINT)],
)
def test_node_stops_cleanly_while_it_is_being_imported(executables, name, number):
    process = executables.start(name, *NODES[name], PYTHONPROFILEIMPORTTIME="1")
    logging(process, "rclpy")
    process.send_signal(number)
    assert process.wait(30.0) == 0
    assert "Traceback" not in process.log.read_text()


def test_tool_that_is_interrupted_during_its_imports_prints_nothing(executables):
    process = executables.start("track_bag", "none", PYTHONPROFILEIMPORTTIME="1")
    logging(process, "numpy")
    process.send_signal(signal.SIGINT)
    assert process.wait(10.0) == 130
    assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize("name", NODES)
def test_node_shows_its_help(processes, name):
    status, text = processes.run(name, "--help")
    assert status == 0
    assert text.startswith(f"usage: {name} [-h]")
    assert "`" not in text  # Names of modules are for those who read the code


@pytest.mark.parametrize("name", NODES)
def test_node_refuses_stray_words_and_what_is_no_time_to_go_by(processes, tmp_path, name):
    status, text = processes.run(name, *NODES[name][:1], "--params-file", tmp_path / "p.yaml")
    assert status == 2
    assert text.splitlines()[-1] == (
        f"{name}: --params-file: is a ROS argument, must follow --ros-args"
    )
    words = NODES[name][:1]
    status, text = processes.run(name, *words, "--ros-args", "-p", "use_sim_time:=5")
    assert status == 2
    assert "use_sim_time" in text
    assert "Traceback" not in text


def test_tracker_starts_without_what_it_does_not_need():
    # Together they took more than a second of every start.
    heavy = ["matplotlib", "plotly", "mcap", "pyproj", "rich", "scipy.stats", "scipy.optimize"]
    heavy += ["scipy.spatial", "urllib.request"]
    heavy += [f"phd_jdtc_ros.{name}" for name in ("calibration.tuning", "evaluation", "report")]
    script = f"import sys, phd_jdtc_ros.nodes.tracker.node; print(set({heavy}) & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60.0
    )
    assert done.stdout == "set()\n"


def test_tracker_lists_every_parameter_fault(processes):
    status, text = processes.run(
        "tracker",
        "--ros-args",
        *("-p", "lag:=-1"),
        *("-p", "survival:=0.9"),
        *("-p", "radar_1.range_std:=.nan"),
        *("-p", "class_0.snr_band_db:=[1.0]"),
    )
    assert status == 2
    assert "lag: -1 given, must be a whole number, at least 0, at most 100" in text
    assert "survival: unknown parameter" in text
    assert "radar_1.range_std: nan given" in text
    assert "class_0.snr_band_db: [1.0] given" in text or "class_0.snr_band_db: array" in text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("name", "words", "fault"),
    [
        ("tracker", ("radar_1.topic:=not a topic",), "must be a topic's name"),
        ("evaluator", ("tracker:=/9x",), "tracker: '/9x' given, must be a node's name"),
        ("sensor_replay", (f"bag:={BAG}", "rate:=-1.0"), "rate: "),
        ("sensor_replay", (), "bag: '' given, must be the path of a bag or the name of a shipped"),
        ("sensor_replay", ("bag:=/none",), "sensor_replay: /none: no such bag"),
    ],
)
def test_node_refuses_impossible_values(processes, name, words, fault):
    ros = (word for given in words for word in ("-p", given))
    status, text = processes.run(name, "--ros-args", *ros)
    assert status == 2
    assert text.splitlines()[-1].startswith(f"{name}: ")
    assert text.count(fault) == 1
    assert "Traceback" not in text


def test_evaluator_refuses_to_overwrite_a_recording(processes, tmp_path):
    (tmp_path / "bag").mkdir()
    status, text = processes.run("evaluator", "--ros-args", "-p", f"record:={tmp_path / 'bag'}")
    assert status == 2
    assert "already exists" in text
    assert "Traceback" not in text
