import sys

import pytest

from robustness.harness import rig
from robustness.harness.rig import START_S, Node, start_limit_s


@pytest.mark.parametrize(("load", "times"), [(0.0, 1.0), (2.0, 1.0), (14.0, 7.0)])
def test_start_limit_grows_with_what_waits_for_the_cpus(load, times, monkeypatch):
    monkeypatch.setattr(rig.os, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(rig.os, "sched_getaffinity", lambda _: {0, 1})
    assert start_limit_s() == times * START_S


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("import time; print('harmless', flush=True); time.sleep(60)", "runs, but has not said"),
        ("print('harmless'); raise SystemExit(3)", "ended with status 3 before it said"),
    ],
)
def test_a_node_that_does_not_start_is_distinguished_from_a_slow_one(program, reason, tmp_path):
    node = Node([sys.executable, "-c", program], tmp_path / "log", 0, {})
    assert not node.said("tracking", 3.0)
    assert node.why_not("tracking").startswith(reason)
    assert "the end of its output:\nharmless" in node.why_not("tracking")
    node.stop()
