# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo in one command: replay, track and evaluate over DDS, then write the report.

The three nodes run as separate processes in their own ROS domain, on this machine only. The replay
is in lock-step with the tracker, so it runs as fast as the CPU allows and loses no message. The
tracker has the parameters beside the bag, unless others are given. What an earlier demo has left is
replaced once the nodes have ended well; until then it stays as it is.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from msg_adapters import names
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.engines import ENGINES
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.nodes.common import bag_parameters
from phd_jdtc_ros.report.pictures import figures

from . import command, comparison, report

START_S, STOP_S = 60.0, 10.0
# Discovery, and the evaluator's last scores, take a second or two.
FINISH_S = 30.0
METRICS, RECORDING, LOGS = "metrics.json", "estimates", "logs"
PARAMETERS = bag_parameters.NAME
# Where a demo writes until its nodes have ended well, relative to its output directory.
UNFINISHED = ".unfinished"
# All files that a demo writes, relative to its output directory.
ARTEFACTS = (
    METRICS,
    report.PAGE,
    *(f"{picture.name}.png" for picture in figures.PICTURES),
    *(f"{LOGS}/{node}.log" for node in ("evaluator", "tracker", "sensor_replay")),
    f"{LOGS}/{PARAMETERS}",
    *(f"{RECORDING}/{name}" for name in (f"{RECORDING}_0.mcap", "metadata.yaml", PARAMETERS)),
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
        self._stop(*self._running)

    def _stop(self, *names: str) -> None:
        stopped = [self._running[name] for name in names]
        for process in stopped:
            if process.poll() is None:
                # A job that a script starts in the background ignores SIGINT, and so would they.
                process.terminate()
        for process in stopped:
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
                print(f"demo: {name} did not get ready\n{self._tail(name)}", file=sys.stderr)
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
                # Its last words are what it waited for.
                self._stop(name)
                print(f"demo: {name} did not finish\n{self._tail(name)}", file=sys.stderr)
                return False
            time.sleep(0.05)
        if self._running[name].returncode != 0:
            print(f"demo: {name} failed\n{self._tail(name)}", file=sys.stderr)
        return self._running[name].returncode == 0

    def _tail(self, name: str) -> str:
        return "\n".join((self._logs / f"{name}.log").read_text().splitlines()[-10:])


def run_nodes(
    bag: Path, config: TrackerConfig, out: Path, logs: Path, cutoff: float = command.CUTOFF
) -> bool:
    """Run the three nodes over a bag; return whether none of them failed.

    Parameters
    ----------
    bag : Path
    config : TrackerConfig
        What the tracker gets.
    out : Path
        Directory for the results.
    logs : Path
        Directory for what the nodes log, and for the tracker's parameters.
    cutoff : float
        c of OSPA and GOSPA, metres.
    """
    scans = BagReader(bag).counts[names.TRUTH]
    if not scans:
        raise BagError(f"{bag}: no message on {names.TRUTH}, the truth that the demo needs")
    topics, poses = [radar.topic for radar in config.inputs], list(config.carried)
    reliable = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable" for topic in [*topics, *poses]
    }
    parameters = logs / PARAMETERS
    reporting = {
        "report": out / METRICS,
        "record": out / RECORDING,
        "radar_topics": f"[{', '.join(topics)}]",
        "classes": len(config.model.modes.classes),
        "world_frame": config.world_frame,
        "exit_after_scans": scans,
        "cutoff": cutoff,
        "class_names": f"[{', '.join(kind.name for kind in config.model.modes.classes)}]",
    }
    if poses:
        reporting["pose_topics"] = f"[{', '.join(poses)}]"
        reporting["pose_message"] = config.pose_message
    patient = {"subscriber_timeout_s": START_S, "truth_timeout_s": START_S}
    # The evaluator scores the truth and records it; what it records of the radars, the tracker has.
    patient["subscribers"] = 2
    patient["answer_delay_s"] = config.answer_delay_s
    flushing = {"flush_service": f"{names.TRACKER}/flush", **patient}
    with Processes(logs) as nodes:
        bag_parameters.write(parameters, config.values)
        nodes.start("evaluator", [], reporting)
        nodes.start("tracker", ["--ros-args", "--params-file", str(parameters)], reliable)
        # The replay waits for its own subscribers, but cannot see whether the evaluator and the
        # tracker have found each other.
        if not (nodes.wait_for("tracker", "tracking") and nodes.wait_for("evaluator", "connected")):
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
    return resources.bag(resources.DEFAULT_BAG)


def _default_out(given: str, engine: str | None) -> Path:
    """Return where the demo of a bag and an engine goes.

    That of a shipped bag other than the default by its name, and that of an engine by its.
    """
    named = Path(given).name == given != resources.DEFAULT_BAG and not Path(given).exists()
    parts = ["demo", *([given] if named else []), *([engine] if engine else [])]
    return Path("out", "_".join(parts))


def _compare(bag: Path, config: TrackerConfig, out: Path) -> None:
    """Add the scores of the other engine on the same bag to the metrics, if it can track it."""
    path = out / METRICS
    summary, other = json.loads(path.read_text()), comparison.other_engine(config)
    if not summary.get("scans") or other is None:
        return
    with tempfile.TemporaryDirectory() as directory:
        compared = comparison.scores(bag, other, Path(directory) / "bag")
    text = json.dumps({**summary, "compared": compared}, indent=2, allow_nan=False)
    path.write_text(text + "\n")


def _replace(out: Path, new: Path) -> None:
    """Put what is in `new` in the place of the results of an earlier demo, and of no other file."""
    for name in ARTEFACTS:
        if not name.startswith(f"{LOGS}/"):
            (out / name).unlink(missing_ok=True)
    if (out / RECORDING).is_dir():
        (out / RECORDING).rmdir()
    for path in new.iterdir():
        path.rename(out / path.name)


def _check_recording(out: Path) -> None:
    """Refuse to begin if the recording's directory could not be replaced in the end."""
    ours = {out / name for name in ARTEFACTS}
    others = [path for path in (out / RECORDING).glob("*") if path not in ours]
    if others:
        raise BagError(f"{others[0]}: is not of a demo, so {out / RECORDING} is not replaced")


def main(argv: Sequence[str]) -> int:
    """Run the demo."""
    parser = ArgumentParser("demo", description=__doc__)
    parser.add_argument("--bag", help=command.BAG)
    parser.add_argument(
        "--profile", metavar="NAME", help="shipped parameters, config/NAME.yaml, with their bag"
    )
    parser.add_argument(
        "--engine", choices=tuple(ENGINES), help="short for -p engine:=NAME; see docs/engines.md"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="directory; out/demo, or out/demo_NAME for an engine, a profile or a bag given by its "
        "name",
    )
    command.add_cutoff_argument(parser)
    command.add_parameter_arguments(parser)
    parser.set_defaults(cutoff=None)
    arguments = parser.parse_args(argv)

    def work() -> int:
        cutoff = arguments.cutoff
        if cutoff is None:
            cutoff = resources.PROFILE_CUTOFFS.get(arguments.profile, command.CUTOFF)
        given = arguments.bag or resources.DEFAULT_BAG
        if arguments.profile:
            path, shown = resources.profile(arguments.profile)
            arguments.params_file.insert(0, path)
            given = arguments.bag or shown
        if arguments.engine:
            arguments.assignments.append(f"engine:={arguments.engine}")
        bag = resources.bag(given)
        if not bag.exists():
            raise BagError(f"{bag}: no such bag")
        out: Path = arguments.out or _default_out(arguments.profile or given, arguments.engine)
        config = command.tracker_config(arguments, bag)
        _check_recording(out)
        with _unfinished(out) as new:
            if not run_nodes(bag, config, new, out / LOGS, cutoff):
                return FAILED
            if bag.resolve() == shipped_bag().resolve():
                _compare(bag, config, new)
            _replace(out, new)
        summary = json.loads((out / METRICS).read_text())
        report.write(out / RECORDING, out, config, bag.resolve().name, summary, cutoff)
        return OK

    return command.guarded("demo", work)


@contextmanager
def _unfinished(out: Path) -> Iterator[Path]:
    """Have a new directory below `out`, which is removed in the end, on SIGTERM too."""
    new = out / UNFINISHED
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield new
    finally:
        signal.signal(signal.SIGTERM, before)
        if any(new.iterdir()) and (out / METRICS).exists():
            print(f"demo: the results in {out} are those of an earlier demo", file=sys.stderr)
        shutil.rmtree(new, ignore_errors=True)
