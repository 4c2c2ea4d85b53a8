"""What becomes of a node whose callback raises."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.live

SCRIPT = """
import rclpy
from phd_jdtc_ros.nodes.common import runtime

class Failing(runtime.RunnableNode):
    def __init__(self):
        super().__init__("failing")
        self.create_timer(0.01, self.fail)

    def fail(self):
        raise ArithmeticError("half-way")

    def close(self):
        print("closed with", self.exit_status)
        {close}

    def destroy_node(self):
        print("destroyed")
        super().destroy_node()

try:
    runtime.run("failing", Failing, [])
except Exception as error:
    print("raised", error)
print("up" if rclpy.ok() else "down")
"""


def logged(close):
    """Return the lines of a run whose node does that at its closing."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(close=close)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60.0,
    )
    return done.stdout.splitlines()


def test_node_closes_with_its_failure_and_is_destroyed_even_if_that_fails_too():
    assert logged("pass") == ["closed with 1", "destroyed", "raised half-way", "down"]
    assert logged("raise OSError('full')") == ["closed with 1", "destroyed", "raised full", "down"]
