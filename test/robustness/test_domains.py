import socket
import subprocess
import sys

import pytest

from robustness.harness import domains, rig
from robustness.harness.domains import Domain
from robustness.harness.rig import START_S, Node, start_limit_s

CLAIM = (
    "from robustness.harness.domains import Domain; "
    "d = Domain(); print(d.number, flush=True); input()"
)


def test_domain_is_one_processs_alone(monkeypatch):
    monkeypatch.setattr(domains, "DOMAINS", range(90, 93))
    taken = []

    def take_four():
        for _ in range(4):
            taken.append(Domain())

    with pytest.raises(RuntimeError, match="90 to 92 are all taken"):
        take_four()
    numbers = [domain.number for domain in taken]
    assert len(set(numbers)) == len(numbers)
    for domain in taken:
        domain.release()


def test_domain_of_another_process_is_passed_over_until_that_ends(monkeypatch):
    with subprocess.Popen(
        [sys.executable, "-c", CLAIM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        number = int(other.stdout.readline())
        assert domains._lock(number) is None
        other.kill()
    monkeypatch.setattr(domains, "DOMAINS", range(number, number + 1))
    mine = Domain()
    assert mine.number == number
    mine.release()


def test_domain_whose_ports_are_taken_is_passed_over():
    mine = Domain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
        foreign.bind(("127.0.0.1", 7410 + 250 * mine.number))
        assert not domains._ports_free(mine.number)
    assert domains._ports_free(mine.number)
    mine.release()


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
