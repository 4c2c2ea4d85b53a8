"""The tools read a parameter file as the node does."""

from pathlib import Path

import pytest
import rclpy

from phd_jdtc_ros.nodes.common import parameters
from phd_jdtc_ros.parameter_files import from_arguments, sections

pytestmark = pytest.mark.live

ROOT = Path(__file__).parents[3]

FILES = {
    "everyone": "/**: {ros__parameters: {lag: 1}}",
    "later wildcard": (
        "/north/tracker: {ros__parameters: {lag: 1}}\n/**: {ros__parameters: {lag: 2}}"
    ),
    "later name": "/**: {ros__parameters: {lag: 2}}\n/north/tracker: {ros__parameters: {lag: 1}}",
    "no slash": "north/tracker: {ros__parameters: {lag: 1}}",
    "nested": "north: {tracker: {ros__parameters: {lag: 1, radar_1: {range_std: 5.0}}}}",
    "any namespace": "/*/tracker: {ros__parameters: {lag: 1}}",
    "of a namespace": "/north/*: {ros__parameters: {lag: 1}}",
    "any depth": (
        "/north/tracker: {ros__parameters: {lag: 1}}\n/north/**: {ros__parameters: {lag: 2}}"
    ),
    "others": (
        "/north/tracker: {ros__parameters: {lag: 1}}\n"
        "/*: {ros__parameters: {lag: 2}}\n/south/**: {ros__parameters: {lag: 3}}"
    ),
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_tools_read_the_sections_that_a_node_reads(tmp_path, text):
    path = tmp_path / "p.yaml"
    path.write_text(text + "\n")
    context = rclpy.Context()
    rclpy.init(context=context, args=["--ros-args", "--params-file", str(path)])
    node = rclpy.create_node("tracker", namespace="/north", context=context)
    try:
        found = parameters.given_values(node, [sections.read(path)])
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert found
    assert from_arguments.load(path) == found


@pytest.mark.parametrize("name", ["three_classes", "mine"])
def test_scenario_file_is_refused_with_what_to_give_instead(processes, tmp_path, name):
    path = tmp_path / f"{name}.yaml"
    path.write_text((ROOT / "config" / "scenarios" / "three_classes.yaml").read_text())
    status, text = processes.run("tracker", "--ros-args", "--params-file", path)
    instead = {
        "three_classes": "bags/three_classes/parameters.yaml",
        "mine": "the parameters.yaml that simulate writes",
    }[name]
    assert status == 2
    assert text == (
        f"tracker: {path}: is a scenario file, must be a parameter file: give {instead}; offline "
        "tools take the scenario as --scenario\n"
    )
