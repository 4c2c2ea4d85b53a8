"""The demo's processes: none is left behind."""

import signal
import subprocess
import sys

import pytest

from phd_jdtc_ros import interruption
from phd_jdtc_ros.tools.demo.processes import Processes


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_node_that_starts_while_the_demo_is_interrupted_is_ended(number, tmp_path, monkeypatch):
    started, start = [], subprocess.Popen

    def interrupted(*_, **__):
        started.append(start([sys.executable, "-c", "import time; time.sleep(60.0)"]))
        signal.raise_signal(number)
        return started[0]

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    try:
        with (
            pytest.raises(KeyboardInterrupt),
            interruption.accepted(),
            Processes(tmp_path) as processes,
        ):
            processes.start("tracker", [], {})
        status = started[0].poll()
    finally:
        started[0].kill()

    assert status is not None
