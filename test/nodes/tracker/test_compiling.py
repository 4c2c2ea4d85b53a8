"""A tracker that compiles says so before its node exists."""

import subprocess
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.nodes.tracker import node

pytestmark = pytest.mark.live
ARGUMENTS = ["--ros-args", "-r", "__ns:=/coast"]


@pytest.fixture(autouse=True)
def announced_again():
    compilation._announce.cache_clear()
    yield
    compilation._announce()


def test_reported_says_that_the_tracker_compiles_under_its_own_name(peer):
    found = peer.collect(DiagnosticArray, "/diagnostics")
    with node.report_compilation(ARGUMENTS):
        compilation._announce()
        assert peer.spin_until(lambda: found)
    summary, line = found[0].status
    assert [summary.name, line.name] == ["/coast/tracker: summary", "/coast/tracker: step time"]
    assert (line.level, line.message) == (DiagnosticStatus.STALE, node.COMPILING)
    assert (summary.level, summary.message) == (line.level, f"step time: {node.COMPILING}")
    assert peer.spin_until(lambda: not peer.node.count_publishers("/diagnostics"))


def test_reported_makes_no_node_where_nothing_is_compiled(peer):
    with node.report_compilation(ARGUMENTS):
        assert not peer.spin_until(lambda: peer.node.count_publishers("/diagnostics"), 1.0)
    assert compilation.ON_COMPILATION == []


CONFIGURED_AFTER_LOADING = """
import sys
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.nodes.tracker import node
from phd_jdtc_ros.parameter_files import from_arguments

given = from_arguments.profile(sys.argv[1])
node._load(repr(given))
loaded = len(compilation._COMPILED_BY), len(compilation._OF_SIZE)
new_pipeline(resolve({**given, "world_origin": []}))
assert loaded == (len(compilation._COMPILED_BY), len(compilation._OF_SIZE)), loaded
"""


@pytest.mark.parametrize("profile", ["surveillance", "harbour", "lidar", "drone", "phd"])
def test_nothing_is_compiled_by_a_node_that_must_answer_and_stop(profile):
    code = [sys.executable, "-c", CONFIGURED_AFTER_LOADING, profile]
    subprocess.run(code, check=True)
