"""Plays the detections and the truth of a bag, at a rate or in lock-step with a tracker."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from enum import Enum, auto
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import interfaces, names, stamps
from msg_adapters.bag import BagError, BagMessage, BagReader
from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.parameters import Parameter
from phd_jdtc_ros.exits import FAILED, OK, fail

from . import parameters, runtime
from .playback import Playback, ProgressBar

OUTPUT_QOS = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
CLOCK_PERIOD_S = 0.01
TICK_S = 0.005
SLOWEST_RATE = 0.1

# Endpoints see each other a moment after the graph shows them.
SETTLE_S = 0.5
# In lock-step an estimate may be held back until a later stamp comes (radars without a common
# scan), so after this long a few more stamps are allowed out.
PATIENCE_S = 1.0
MOST_OUTSTANDING = 4
GIVE_UP_S = 30.0
ACKNOWLEDGE_S = 5.0

TABLE = (
    Parameter("bag", "", "Path of the bag: a rosbag2 directory or an MCAP file."),
    Parameter(
        "rate",
        1.0,
        "Speed against the recording, from 0.1; 0 is lock-step: a stamp is published once the "
        "estimate of the one before has come back.",
        0.0,
        1000.0,
    ),
    Parameter("loop", False, "Start again at the end."),
    Parameter("start_s", 0.0, "Skip this much of the bag, s.", 0.0),
    Parameter("duration_s", 0.0, "Play this much of the bag, s; 0 for all.", 0.0),
    Parameter("start_paused", False, "Wait for ~/resume or ~/step."),
    Parameter(
        "topics",
        [],
        "Topics to play; empty for all whose name ends in /detections, and the truth.",
        element=str,
    ),
    Parameter("subscriber_timeout_s", 5.0, "Longest wait for subscribers, s.", 0.0, 3600.0),
    Parameter(
        "estimates_topic",
        names.estimates("filtered"),
        "What comes back in lock-step.",
    ),
    Parameter("flush_service", "", "Service called at the end, such as /tracker/flush."),
    Parameter("progress", True, "Draw a progress bar."),
)


class State(Enum):
    """What the replay is doing."""

    WAITING = auto()
    PLAYING = auto()
    DRAINING = auto()
    FLUSHING = auto()


class SensorReplay(Node):
    """Publishes a bag's messages as the bytes they were recorded as."""

    def __init__(self, flags: dict[str, Any]) -> None:
        super().__init__("sensor_replay")
        self._values = parameters.resolve(self, TABLE, flags)
        _check(self._values)
        self.exit_status: int | None = None
        self._bag = BagReader(Path(self._values["bag"]))
        self._types = _played(self._bag, self._values["topics"])
        self._outputs = {
            topic: self.create_publisher(interfaces.message_class(name), topic, OUTPUT_QOS)
            for topic, name in self._types.items()
        }
        self._clock_output = self.create_publisher(Clock, "/clock", CLOCK_QOS)
        self._estimate_ns: int | None = None
        self._outstanding: list[int] = []
        if self._lock_step:
            self.create_subscription(
                PointCloud2, self._values["estimates_topic"], self._on_estimate, OUTPUT_QOS
            )
        self._flush = (
            self.create_client(Trigger, self._values["flush_service"])
            if self._values["flush_service"]
            else None
        )
        self._flushed: Future | None = None
        self._paused = bool(self._values["start_paused"])
        self._steps = 0
        self._state = State.WAITING
        self._since = time.monotonic()
        self._ready_since: float | None = None
        self._now_ns = self._bag.start_ns
        self._playback = Playback(
            self._bag, list(self._types), self._values["start_s"], self._values["duration_s"]
        )
        self._bar = ProgressBar(bool(self._values["progress"]))
        for name, callback in (
            ("pause", self._on_pause),
            ("resume", self._on_resume),
            ("step", self._on_step),
        ):
            self.create_service(Trigger, f"~/{name}", callback)
        self.create_timer(CLOCK_PERIOD_S, self._publish_clock)
        self.create_timer(TICK_S, self._tick)

    @property
    def _lock_step(self) -> bool:
        return bool(self._values["rate"] == 0.0)

    def close(self) -> None:
        """Stop the progress bar."""
        self._bar.stop()

    def _tick(self) -> None:
        if self._state is State.WAITING:
            self._wait_for_subscribers()
        elif self._state is State.PLAYING:
            self._play()
        elif self._state is State.DRAINING:
            self._drain()
        else:
            self._finish_flush()

    def _enter(self, state: State) -> None:
        self._state = state
        self._since = time.monotonic()

    def _wait_for_subscribers(self) -> None:
        now = time.monotonic()
        missing = [t for t, output in self._outputs.items() if not output.get_subscription_count()]
        if self._lock_step and not self.count_publishers(self._values["estimates_topic"]):
            missing.append(self._values["estimates_topic"])
        if not missing:
            self._ready_since = self._ready_since or now
            if now - self._ready_since < SETTLE_S:
                return
        elif now - self._since < self._values["subscriber_timeout_s"]:
            self._ready_since = None
            return
        else:
            self.get_logger().warning(f"nobody is on {', '.join(missing)}; playing all the same")
        self._restart_clock()
        self._enter(State.PLAYING)

    def _restart_clock(self) -> None:
        """Make the next scan due now."""
        self._wall_start = time.monotonic()
        if self._playback.upcoming is not None:
            self._bag_start_ns = self._playback.upcoming[0].log_time_ns

    def _play(self) -> None:
        while (scan := self._playback.upcoming) is not None:
            if self._paused and self._steps == 0:
                return
            if not (self._may_follow() if self._lock_step else self._is_due(scan)):
                return
            self._publish_scan(scan)
            self._playback.advance()
            self._steps = max(0, self._steps - 1)
            self._bar.show(self._playback.progress)
        if self._values["loop"]:
            self._playback.rewind()
            self._outstanding.clear()
            self._estimate_ns = None
            self._restart_clock()
        else:
            self._enter(State.DRAINING)

    def _is_due(self, scan: list[BagMessage]) -> bool:
        if self._steps:
            return True
        elapsed_ns = (time.monotonic() - self._wall_start) * 1e9 * self._values["rate"]
        due = scan[0].log_time_ns - self._bag_start_ns <= elapsed_ns
        if not due:
            self._now_ns = self._bag_start_ns + int(elapsed_ns)
        return bool(due)

    def _may_follow(self) -> bool:
        """Return whether lock-step lets the next stamp out."""
        while self._outstanding and (self._estimate_ns or 0) >= self._outstanding[0]:
            self._outstanding.pop(0)
            self._since = time.monotonic()
        if not self._outstanding:
            return True
        waited = time.monotonic() - self._since
        if waited > GIVE_UP_S:
            self._fail(f"no estimate on {self._values['estimates_topic']} for {GIVE_UP_S:g} s")
            return False
        return waited > PATIENCE_S and len(self._outstanding) < MOST_OUTSTANDING

    def _publish_scan(self, scan: list[BagMessage]) -> None:
        self._now_ns = scan[0].log_time_ns
        self._publish_clock()
        for message in scan:
            self._outputs[message.topic].publish(message.data)
        if self._lock_step:
            self._outstanding.append(scan[0].stamp_ns)
            if len(self._outstanding) == 1:
                self._since = time.monotonic()

    def _drain(self) -> None:
        """Wait until what was published has arrived, then flush the tracker if asked to."""
        waited = time.monotonic() - self._since
        if self._lock_step and not self._may_follow() and waited < PATIENCE_S:
            return
        for output in self._outputs.values():
            output.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_S))
        if self._flush is None:
            self._end()
        elif self._flush.service_is_ready():
            self._flushed = self._flush.call_async(Trigger.Request())
            self._enter(State.FLUSHING)
        elif waited > ACKNOWLEDGE_S:
            self._fail(f"service {self._values['flush_service']} does not exist")

    def _finish_flush(self) -> None:
        if self._flushed is not None and self._flushed.done():
            self._end()
        elif time.monotonic() - self._since > GIVE_UP_S:
            self._fail(f"service {self._values['flush_service']} does not answer")

    def _end(self) -> None:
        self._bar.stop()
        if self._playback.damage is not None:
            self.exit_status = fail("sensor_replay", self._playback.damage)
        else:
            self.exit_status = OK

    def _fail(self, reason: str) -> None:
        self._bar.stop()
        self.get_logger().error(reason)
        self.exit_status = FAILED

    def _publish_clock(self) -> None:
        self._clock_output.publish(Clock(clock=stamps.from_ns(self._now_ns)))

    def _on_estimate(self, cloud: PointCloud2) -> None:
        self._estimate_ns = stamps.to_ns(cloud.header.stamp)
        self._tick()

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = True
        return _done(response, "paused")

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = False
        self._restart_clock()
        return _done(response, "playing")

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = True
        self._steps += 1
        return _done(response, "one stamp")


def _done(response: Trigger.Response, text: str) -> Trigger.Response:
    response.success = True
    response.message = text
    return response


def _check(values: dict[str, Any]) -> None:
    faults = []
    if not values["bag"]:
        faults.append("bag: '' given, must be the path of a bag")
    if 0.0 < values["rate"] < SLOWEST_RATE:
        faults.append(f"rate: {values['rate']:g} given, must be 0 or at least {SLOWEST_RATE:g}")
    if faults:
        raise ConfigError(faults)


def _played(bag: BagReader, wanted: list[str]) -> dict[str, str]:
    """Return the topics to play with their types.

    Raises
    ------
    BagError
        If one is missing or is no point cloud.
    """
    chosen = wanted or [
        topic
        for topic in bag.types
        if topic.endswith(names.DETECTIONS_SUFFIX) or topic == names.TRUTH
    ]
    if not chosen:
        raise BagError(
            f"{bag.path}: has no topic that ends in {names.DETECTIONS_SUFFIX}; "
            f"it has {', '.join(sorted(bag.types)) or 'none'}"
        )
    bag.require(dict.fromkeys(chosen, names.CLOUD))
    return {topic: bag.types[topic] for topic in chosen}


def _flags(argv: Sequence[str]) -> dict[str, Any]:
    """Return the parameters that plain command-line flags set."""
    parser = argparse.ArgumentParser("sensor_replay", description=__doc__)
    parser.add_argument("bag", nargs="?", help="rosbag2 directory or MCAP file")
    parser.add_argument("--rate", type=float, help="speed; 0 is lock-step")
    parser.add_argument("--start", type=float, dest="start_s", help="skip, s")
    parser.add_argument("--duration", type=float, dest="duration_s", help="play this much, s")
    parser.add_argument("--loop", action="store_true", default=None)
    parser.add_argument("--start-paused", action="store_true", default=None)
    given = vars(parser.parse_args(remove_ros_args(["sensor_replay", *argv])[1:]))
    return {name: value for name, value in given.items() if value is not None}


def main(argv: Sequence[str]) -> int:
    """Run the replay node."""
    flags = _flags(argv)
    return runtime.run("sensor_replay", lambda: SensorReplay(flags), argv)
