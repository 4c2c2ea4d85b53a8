# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo in one command: replay, track and evaluate over DDS, then write the report.

The three nodes run as separate processes in their own ROS domain, on this machine only. The replay
is in lock-step with the tracker, so it runs as fast as the CPU allows and loses no message.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from msg_adapters import names
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.report.pictures import figures

from . import command, report, resources

START_S, STOP_S = 60.0, 10.0
# Discovery, and the evaluator's last scores, take a second or two.
FINISH_S = 30.0
METRICS, RECORDING, LOGS = "metrics.json", "estimates", "logs"
# All files that a demo writes, relative to its output directory.
ARTEFACTS = (
    METRICS,
    report.PAGE,
    *(f"{picture.name}.png" for picture in figures.PICTURES),
    *(f"{LOGS}/{node}.log" for node in ("evaluator", "tracker", "sensor_replay")),
    *(f"{RECORDING}/{name}" for name in (f"{RECORDING}_0.mcap", "metadata.yaml")),
)


class Processes:
    """The demo's nodes; those still running are stopped when the context ends."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._environment = {
            **os.environ,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID") or str(1 + os.getpid() % 100),
            **resources.isolation(),
        }
        logs.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running.values():
            if process.poll() is None:
                # A job that a script starts in the background ignores SIGINT, and so would they.
                process.terminate()
        for process in self._running.values():
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def start(
        self,
        name: str,
        arguments: Sequence[str],
        parameters: Mapping[str, object],
        shown: bool = False,
    ) -> None:
        """Start a node; its output goes to its log, or to the terminal if `shown`."""
        line = [sys.executable, "-m", "phd_jdtc_ros", name, *arguments, "--ros-args"]
        for key, value in parameters.items():
            line += ["-p", f"{key}:={value}"]
        with (self._logs / f"{name}.log").open("wb") as log, _interrupts_deferred():
            self._running[name] = subprocess.Popen(
                line, stdout=None if shown else log, stderr=log, env=self._environment
            )

    def wait_for(self, name: str, text: str) -> bool:
        """Wait until a node has logged `text`; return whether it did."""
        deadline = time.monotonic() + START_S
        while text not in (self._logs / f"{name}.log").read_text():
            if self._running[name].poll() is not None or time.monotonic() > deadline:
                print(f"demo: {name} did not start\n{self._tail(name)}", file=sys.stderr)
                return False
            time.sleep(0.05)
        return True

    def wait(self, name: str, timeout_s: float | None = None) -> bool:
        """Wait until a node ends; return whether it and the others ran without failure."""
        deadline = time.monotonic() + timeout_s if timeout_s else None
        while self._running[name].poll() is None:
            ended = [n for n, process in self._running.items() if process.poll()]
            if ended:
                print(f"demo: {ended[0]} ended early\n{self._tail(ended[0])}", file=sys.stderr)
                return False
            if deadline and time.monotonic() > deadline:
                print(f"demo: {name} did not finish\n{self._tail(name)}", file=sys.stderr)
                return False
            time.sleep(0.05)
        if self._running[name].returncode != 0:
            print(f"demo: {name} failed\n{self._tail(name)}", file=sys.stderr)
        return self._running[name].returncode == 0

    def _tail(self, name: str) -> str:
        return "\n".join((self._logs / f"{name}.log").read_text().splitlines()[-10:])


def run_nodes(bag: Path, out: Path) -> bool:
    """Run the three nodes over a bag, with output to `out`; return whether none of them failed."""
    scans = BagReader(bag).counts[names.TRUTH]
    if not scans:
        raise BagError(f"{bag}: no message on {names.TRUTH}, the truth that the demo needs")
    reliable = {
        f"qos_overrides.{radar.topic}.subscription.reliability": "reliable"
        for radar in resolve({}).inputs
    }
    reporting = {
        "report": out / METRICS,
        "record": out / RECORDING,
        "exit_after_scans": scans,
    }
    flushing = {"flush_service": f"{names.TRACKER}/flush", "subscriber_timeout_s": 20.0}
    with Processes(out / LOGS) as nodes:
        nodes.start("evaluator", [], reporting)
        nodes.start("tracker", [], reliable)
        # The replay waits for its own subscribers, but cannot see whether the evaluator has found
        # the tracker. That has to happen while the replay starts.
        if not (nodes.wait_for("evaluator", "waiting") and nodes.wait_for("tracker", "tracking")):
            return False
        nodes.start("sensor_replay", [str(bag), "--rate", "0"], flushing, shown=True)
        return nodes.wait("sensor_replay") and nodes.wait("evaluator", FINISH_S)


@contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Handle signals to end only afterwards, so that no process starts without being recorded."""
    received: list[int] = []
    before = {
        number: signal.signal(number, lambda caught, _: received.append(caught))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in received:
        signal.raise_signal(number)


def shipped_bag() -> Path:
    """Return the reference scenario's bag, from the checkout or the installed package."""
    return resources.find(Path("bags/paper_scenario"))


def _clear(out: Path) -> None:
    """Remove the files of an earlier demo, and no others."""
    for name in ARTEFACTS:
        (out / name).unlink(missing_ok=True)
    # A recording needs a new directory; one with other files in it is not removed.
    if (out / RECORDING).is_dir():
        (out / RECORDING).rmdir()


def main(argv: Sequence[str]) -> int:
    """Run the demo."""
    parser = ArgumentParser("demo", description=__doc__)
    parser.add_argument("--bag", type=Path, default=shipped_bag())
    parser.add_argument("--out", type=Path, default=Path("out/demo"))
    arguments = parser.parse_args(argv)

    def work() -> int:
        if not arguments.bag.exists():
            raise BagError(f"{arguments.bag}: no such bag")
        out: Path = arguments.out
        _clear(out)
        # On SIGTERM the nodes are stopped too.
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            if not run_nodes(arguments.bag, out):
                return FAILED
        finally:
            signal.signal(signal.SIGTERM, before)
        summary = json.loads((out / METRICS).read_text())
        report.write(out / RECORDING, out, resolve({}), arguments.bag.resolve().name, summary)
        return OK

    return command.guarded("demo", work)
