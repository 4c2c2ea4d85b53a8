"""The demo's launch file, run as `ros2 launch` runs it, where a ROS installation has launch."""

import json
import os
import tempfile
import unittest
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory

from robustness.harness.isolation import ISOLATED

launch = pytest.importorskip("launch", reason="launch is not installed")
actions = pytest.importorskip("launch.actions", reason="launch is not installed")
sources = pytest.importorskip("launch.launch_description_sources")
launch_testing = pytest.importorskip("launch_testing", reason="launch_testing is not installed")
ready = pytest.importorskip("launch_testing.actions").ReadyToTest
asserts = pytest.importorskip("launch_testing.asserts")
pytest.importorskip("launch_ros", reason="launch_ros is not installed")

try:
    SHARE = Path(get_package_share_directory("phd_jdtc_ros"))
except LookupError:
    pytest.skip("the package is not built with colcon", allow_module_level=True)

OUT = Path(tempfile.mkdtemp())


@pytest.mark.launch_test
def generate_test_description():
    # Launch sets its own in this very process.
    for name in ISOLATED:
        os.environ.pop(name, None)
    demo = actions.IncludeLaunchDescription(
        sources.PythonLaunchDescriptionSource(str(SHARE / "launch" / "demo.launch.py")),
        launch_arguments={"out": str(OUT), "namespace": "alpha"}.items(),
    )
    return launch.LaunchDescription([demo, ready()])


class TestDemo(unittest.TestCase):
    """While the nodes run."""

    def test_evaluator_ends_by_itself(self, proc_info):
        proc_info.assertWaitForStartup(process="evaluator", timeout=20)
        proc_info.assertWaitForShutdown(process="evaluator", timeout=90)


@launch_testing.post_shutdown_test()
class TestDemoAfterwards(unittest.TestCase):
    """Once all have ended."""

    @classmethod
    def tearDownClass(cls):
        os.environ.update(ISOLATED)

    def test_every_node_ended_well(self, proc_info):
        asserts.assertExitCodes(proc_info)

    def test_every_node_kept_to_this_machine(self, proc_info):
        profiles = {info.env.get(name) for info in proc_info for name in ISOLATED}
        assert profiles == {str(SHARE / "config" / "dds" / "localhost_only.xml")}

    def test_every_scan_was_scored(self):
        assert json.loads((OUT / "metrics.json").read_text())["scans"] == 80
