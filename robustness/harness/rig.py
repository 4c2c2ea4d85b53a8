"""The nodes under test as processes, in their own ROS domain, on this machine only."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .domains import Domain

if TYPE_CHECKING:
    from .radars import Radars

# Longest start of a node on an idle machine, and longest stop; see `start_limit_s`.
START_S, STOP_S = 30.0, 10.0


def start_limit_s() -> float:
    """Return the longest start of a node, seconds, which grows with the load of the machine."""
    return START_S * max(1.0, os.getloadavg()[0] / len(os.sched_getaffinity(0)))


def options(values: Mapping[str, object]) -> list[str]:
    """Return a node's arguments that set parameters."""
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


RELIABLE = options(
    {
        f"qos_overrides./{radar}/detections.subscription.reliability": "reliable"
        for radar in ("radar_1", "radar_2")
    }
)
# A tracker with very short steps, for measurements that do not concern them.
LIGHT = options({"accuracy": "fast", "lag": 2})


def launch(
    command: Sequence[str], log: Path, environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """Start a process whose output goes to a file."""
    with log.open("wb") as stream:
        return subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, env=environment)


class Node:
    """A running executable of the package, with its output.

    Its environment is in addition to that of this process.
    """

    def __init__(
        self, command: Sequence[str], log: Path, domain: int, environment: Mapping[str, str]
    ) -> None:
        self._log = log
        everything = {**os.environ, "ROS_DOMAIN_ID": str(domain), **environment}
        # A user's interpreter stores the bytecode of modules, so that a start need not compile it.
        everything.pop("PYTHONDONTWRITEBYTECODE", None)
        self.process = launch(command, log, everything)

    @property
    def alive(self) -> bool:
        """Whether the process is still running."""
        return self.process.poll() is None

    @property
    def text(self) -> str:
        """The output so far."""
        return self._log.read_text(errors="replace")

    def said(self, text: str, timeout_s: float | None = None) -> bool:
        """Wait until the output contains `text`, by default as for a start; return if it does."""
        deadline = time.monotonic() + (start_limit_s() if timeout_s is None else timeout_s)
        while text not in self.text:
            if not self.alive or time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    def why_not(self, text: str) -> str:
        """Return why the output does not contain `text`, after waiting for it."""
        if self.alive:
            load = f"load {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} CPUs"
            reason = f"runs, but has not said {text!r} within {start_limit_s():.0f} s, {load}"
        else:
            reason = f"ended with status {self.process.returncode} before it said {text!r}"
        return f"{reason}; the end of its output:\n{self.text[-2000:]}"

    def stop(self, number: int = signal.SIGTERM) -> int | None:
        """Stop the process by a signal; return its exit status, or None if it had to be killed."""
        if self.alive:
            self.process.send_signal(number)
        try:
            return self.process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return None

    def kill(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.wait()

    def status(self, key: str) -> int:
        """Return a number of the process, such as ``VmRSS`` (KiB) or ``Threads``."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(rf"^{key}:\s+(\d+)", text, re.MULTILINE)
        if found is None:
            raise ValueError(f"/proc/{self.process.pid}/status has no {key}")
        return int(found[1])

    @property
    def descriptors(self) -> int:
        """Number of open file descriptors."""
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))


class Rig:
    """A domain with its nodes and radars; all are stopped when the context ends."""

    def __init__(self) -> None:
        self._domain = Domain()
        self.domain = self._domain.number
        self._directory = tempfile.TemporaryDirectory()
        self.directory = Path(self._directory.name)
        self._nodes: list[Node] = []
        self._radars: Radars | None = None

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *_: object) -> None:
        if self._radars is not None:
            self._radars.close()
        for node in self._nodes:
            node.stop()
        self._domain.release()
        self._directory.cleanup()

    def start(
        self, name: str, *arguments: object, prefix: Sequence[str] = (), **environment: str
    ) -> Node:
        """Start an executable, with a prefix such as ``ip netns exec NAME`` if one is given."""
        module = ("-m", "phd_jdtc_ros", name, *map(str, arguments))
        command = [*prefix, sys.executable, *module]
        log = self.directory / f"{len(self._nodes)}_{name}.log"
        node = Node(command, log, self.domain, environment)
        self._nodes.append(node)
        return node

    def tracker(self, *arguments: object) -> Node:
        """Start a tracker that subscribes reliably, and wait until it tracks."""
        node = self.start("tracker", "--ros-args", *RELIABLE, *arguments)
        if not node.said("tracking"):
            raise RuntimeError(node.why_not("tracking"))
        return node

    def tracking(self, *arguments: object, radars: int = 2) -> tuple[Node, Radars]:
        """Start a tracker as `tracker` does, and connect one or two radars with it."""
        tracker = self.tracker(*arguments)
        self.radars.keep(radars)
        if not self.radars.connected():
            raise RuntimeError(f"the radars did not find the tracker:\n{tracker.text[-2000:]}")
        return tracker, self.radars

    @property
    def radars(self) -> Radars:
        """The radars in this domain, made at the first use."""
        if self._radars is None:
            from .radars import Radars

            self._radars = Radars(self.domain)
        return self._radars
