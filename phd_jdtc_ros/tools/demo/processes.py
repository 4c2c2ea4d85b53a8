"""The processes of a demo, and the evaluator's parameters."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from msg_adapters.encoding import names
from phd_jdtc_ros import interruption, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.parameter_files import bag_parameters, node_tables
from phd_jdtc_ros.parameter_files.node_tables import CLOUD

START_S, STOP_S = 60.0, 10.0
# The evaluator's last scores take a second or two.
FINISH_S = 30.0
METRICS, RECORDING = "metrics.json", "estimates"
PARAMETERS = bag_parameters.NAME


class Processes:
    """The demo's nodes; those still running are stopped when the context ends."""

    PACKAGE = "phd_jdtc_ros"

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
            # Not by SIGINT, which background jobs of a script ignore, with their children.
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
        in_terminal: bool = False,
        module: str = "",
    ) -> None:
        """Start an executable of the package, or a module, as a node.

        Its output goes to its log, or to the terminal if `in_terminal`.
        """
        executable = [module] if module else [self.PACKAGE, name]
        line = [sys.executable, "-m", *executable, *arguments, "--ros-args"]
        for key, value in parameters.items():
            line += ["-p", f"{key}:={value}"]
        # In one step, so that each started process is recorded.
        with (self._logs / f"{name}.log").open("wb") as log, interruption.step():
            self._running[name] = subprocess.Popen(
                line, stdout=None if in_terminal else log, stderr=log, env=self._environment
            )

    def wait_for(self, name: str, text: str) -> bool:
        """Wait until a node has logged `text`; return whether it did."""
        deadline = time.monotonic() + START_S
        while text not in (self._logs / f"{name}.log").read_text():
            if self._running[name].poll() is not None or time.monotonic() > deadline:
                return self._failed(name, "did not get ready")
            time.sleep(0.05)
        return True

    def wait(self, name: str, timeout_s: float | None = None) -> bool:
        """Wait until a node ends; return whether it and the others ran without failure."""
        deadline = time.monotonic() + (timeout_s or math.inf)
        while self._running[name].poll() is None:
            ended = [n for n, process in self._running.items() if process.poll()]
            if ended:
                return self._failed(ended[0], "ended early")
            if time.monotonic() > deadline:
                # The process is stopped first, so that its log ends with the reason.
                self._stop(name)
                return self._failed(name, "did not finish")
            time.sleep(0.05)
        return self._running[name].returncode == 0 or self._failed(name, "failed")

    def _failed(self, name: str, how: str) -> bool:
        """Print how a node has failed, with the end of its log; return False."""
        log = (self._logs / f"{name}.log").read_text().splitlines()
        print(f"demo: {name} {how}", *log[-10:], sep="\n", file=sys.stderr)
        return False


def evaluator_parameters(
    bag: Path, config: TrackerConfig, out: Path, cutoff: float
) -> dict[str, object]:
    """Return the parameters of an evaluator that scores and records a whole bag into `out`.

    Raises `BagError` if the bag has no truth.
    """
    scans = BagReader(bag).counts[names.TRUTH]
    if not scans:
        raise BagError(f"{bag}: no message on {names.TRUTH}, the truth that the demo needs")
    classes = config.model.modes.classes
    return {
        "report": out / METRICS,
        "record": out / RECORDING,
        **{name: f"[{', '.join(words)}]" for name, words in recorded_topics(config).items()},
        "classes": f"[{', '.join(kind.name for kind in classes)}]",
        "exit_after_scans": scans,
        "cutoff": cutoff,
    }


def recorded_topics(config: TrackerConfig) -> dict[str, list[str]]:
    """Return the evaluator's parameters for radars, and for the poses of their platforms."""
    clouds = {radar.topic: CLOUD for radar in config.inputs}
    poses = {radar.pose.topic: radar.pose.message for radar in config.inputs if radar.pose.topic}
    return {"record_topics": [*clouds, *poses], "record_types": [*clouds.values(), *poses.values()]}


def run(
    bag: Path,
    config: TrackerConfig,
    out: Path,
    logs: Path,
    cutoff: float,
    play: Callable[[Processes], bool],
) -> bool:
    """Track and score a bag live; return whether no process failed.

    The results go to `out`, and logs and the tracker's parameters to `logs`. `cutoff` is c of OSPA
    and GOSPA, metres. `play` plays the bag and waits for the evaluator; it returns whether both
    succeeded.
    """
    evaluator = evaluator_parameters(bag, config, out, cutoff)
    # A new installation compiles the engine here, and not while the nodes are waited for.
    new_engine(config)
    given: dict[str, object] = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable"
        for topic in [*(radar.topic for radar in config.inputs), *config.radars_by_platform]
    }
    if config.known_plane is not None:  # Viewers with a map of the earth need it
        given["outputs"] = f"[{', '.join([*node_tables.Node().outputs, 'navsat'])}]"
    with Processes(logs) as nodes:
        parameters = logs / PARAMETERS
        bag_parameters.write(parameters, config.values)
        nodes.start("evaluator", [], evaluator)
        nodes.start("tracker", ["--ros-args", "--params-file", str(parameters)], given)
        # A replay waits for its own subscribers, but cannot see whether the evaluator and the
        # tracker have found each other.
        connected = nodes.wait_for("tracker", "tracking") and nodes.wait_for(
            "evaluator", "connected"
        )
        return connected and play(nodes)


def replay(
    nodes: Processes,
    bag: Path,
    config: TrackerConfig,
    words: Sequence[str] = (),
    name: str = "sensor_replay",
    module: str = "",
) -> bool:
    """Replay a bag by an executable or a module; return whether it and the evaluator succeeded."""
    parameters = {
        "flush_service": f"{names.TRACKER}/flush",
        "subscriber_timeout_s": START_S,
        # The truth has two subscriptions of the evaluator, and each radar the tracker's and one of
        # the evaluator.
        "subscribers": 2,
        "answer_delay_s": config.answer_delay_s,
    }
    arguments = [str(bag), "--rate", "0", *words]
    nodes.start(name, arguments, parameters, in_terminal=True, module=module)
    return nodes.wait(name) and nodes.wait("evaluator", FINISH_S)
