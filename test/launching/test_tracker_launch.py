"""The tracker's launch file, run with executables that only say what they were told."""

import json
import os
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory

launch = pytest.importorskip("launch", reason="launch is not installed")
actions = pytest.importorskip("launch.actions", reason="launch is not installed")
sources = pytest.importorskip("launch.launch_description_sources")
pytest.importorskip("launch_ros", reason="launch_ros is not installed")

try:
    SHARE = Path(get_package_share_directory("phd_jdtc_ros"))
except LookupError:
    pytest.skip("the package is not built with colcon", allow_module_level=True)

EXECUTABLES = {
    "phd_jdtc_ros": "tracker",
    "tf2_ros": "static_transform_publisher",
    "rviz2": "rviz2",
}


@pytest.fixture
def said(tmp_path, monkeypatch):
    """Return a function that launches the file and returns the arguments of what it started."""
    prefix = tmp_path / "prefix"
    notes = tmp_path / "notes"
    notes.mkdir()

    def install(package, executable):
        marker = prefix / "share" / "ament_index" / "resource_index" / "packages" / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
        script = prefix / "lib" / package / executable
        script.parent.mkdir(parents=True)
        script.write_text(
            f"#!{sys.executable}\nimport json, os, sys\n"
            f"with open(f'{notes}/{executable}_{{os.getpid()}}', 'w') as file:\n"
            "    json.dump(sys.argv[1:], file)\n"
        )
        script.chmod(0o755)

    def run(packages, **arguments):
        for package in packages:
            install(package, EXECUTABLES[package])
        # The package's own files, under the prefix of the test.
        (prefix / "share" / "phd_jdtc_ros").symlink_to(SHARE)
        monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}")
        path = str(SHARE / "launch" / "tracker.launch.py")
        service = launch.LaunchService()
        service.include_launch_description(
            launch.LaunchDescription(
                [
                    actions.IncludeLaunchDescription(
                        sources.PythonLaunchDescriptionSource(path),
                        launch_arguments={"respawn": "false", **arguments}.items(),
                    )
                ]
            )
        )
        assert service.run() == 0
        return {
            executable: [
                json.loads(file.read_text()) for file in sorted(notes.glob(f"{executable}_*"))
            ]
            for executable in EXECUTABLES.values()
        }

    return run


def test_the_tracker_gets_its_parameters_and_its_name(said):
    found = said(["phd_jdtc_ros"], namespace="alpha", use_sim_time="true")

    (arguments,) = found["tracker"]
    assert "__node:=tracker" in arguments
    assert "__ns:=/alpha" in arguments
    assert any(entry.endswith("config/paper_scenario.yaml") for entry in arguments)
    assert found["rviz2"] == []


def test_every_radar_gets_its_frame(said):
    found = said(["phd_jdtc_ros", "tf2_ros"])

    places = {}
    for arguments in found["static_transform_publisher"]:
        given = dict(zip(arguments[0:10:2], arguments[1:10:2], strict=True))
        assert given["--frame-id"] == "map"
        places[given["--child-frame-id"]] = [float(given[k]) for k in ("--x", "--y", "--yaw")]
    assert places == {"radar_1": [1000.0, 0.0, 0.0], "radar_2": [0.0, 0.0, 0.0]}


def test_rviz_shows_the_tracker_of_the_namespace(said):
    found = said(["phd_jdtc_ros", "rviz2"], namespace="alpha", rviz="true")

    (arguments,) = found["rviz2"]
    assert any(entry.endswith("rviz/demo.rviz") for entry in arguments)
    assert "/tracker/markers:=/alpha/tracker/markers" in arguments
