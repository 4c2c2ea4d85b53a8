"""Plays a bag: detections, truth and the rest, at a rate or in lock-step with a tracker."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from enum import Enum, auto
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import names, stamps
from msg_adapters.bag import BagReader
from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.parameters import Parameter
from phd_jdtc_ros.exits import FAILED, OK, fail

from . import parameters, playable, runtime
from .playback import Group, Playback, ProgressLine

OUTPUT_QOS = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
LATCHED_QOS = QoSProfile(
    depth=50,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
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

_AT_THE_START = (
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
        "Topics to play; empty for all but /clock, /diagnostics, /rosout, /parameter_events and "
        "what is under /tracker and /evaluator.",
        element=str,
    ),
    Parameter(
        "subscriber_timeout_s",
        5.0,
        "Longest wait for subscribers of the detections and the truth, s.",
        0.0,
        3600.0,
    ),
    Parameter(
        "estimates_topic",
        names.estimates("filtered"),
        "What comes back in lock-step.",
    ),
    Parameter("flush_service", "", "Service called at the end, such as /tracker/flush."),
    Parameter("progress", True, "Draw a progress line, where there is a terminal."),
)
SEEK = Parameter(
    "seek_s",
    0.0,
    "Set while it runs, not before: go on from here, s from the bag's start; refused outside the "
    "part that is played.",
    0.0,
)
TABLE = (*_AT_THE_START, SEEK)


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
        self._values = parameters.resolve(self, _AT_THE_START, flags)
        _check(self._values)
        self.exit_status: int | None = None
        bag = BagReader(Path(self._values["bag"]))
        self._played = playable.choose(bag, self._values["topics"])
        for line in self._played.skipped:
            self.get_logger().warning(line)
        self._outputs = {
            topic: self.create_publisher(
                message_class, topic, LATCHED_QOS if topic in playable.LATCHED else OUTPUT_QOS
            )
            for topic, message_class in self._played.classes.items()
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
        self._playback = Playback(
            bag,
            self._played.classes,
            self._played.scan_topics,
            self._values["start_s"],
            self._values["duration_s"],
        )
        self._now_ns = bag.start_ns
        self._line = ProgressLine(
            bool(self._values["progress"]),
            *(self._playback.seconds(t) for t in (self._playback.first_ns, self._playback.last_ns)),
        )
        for name, callback in (
            ("pause", self._on_pause),
            ("resume", self._on_resume),
            ("step", self._on_step),
        ):
            self.create_service(Trigger, f"~/{name}", callback)
        self._make_seek()
        self.create_timer(CLOCK_PERIOD_S, self._publish_clock)
        self.create_timer(TICK_S, self._tick)

    def _make_seek(self) -> None:
        self.declare_parameter(
            SEEK.name,
            SEEK.default,
            ParameterDescriptor(
                description=SEEK.description,
                additional_constraints=f"must be {SEEK.allowed}",
                dynamic_typing=True,  # a whole number is a number too
            ),
            ignore_override=True,
        )
        self.add_on_set_parameters_callback(self._check_seek)
        self.add_post_set_parameters_callback(self._seek)

    @property
    def _lock_step(self) -> bool:
        return bool(self._values["rate"] == 0.0)

    def close(self) -> None:
        """Stop the progress line."""
        self._line.stop()

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
        awaited = self._played.scan_topics or tuple(self._outputs)
        missing = [t for t in awaited if not self._outputs[t].get_subscription_count()]
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
        self._begin()
        self._enter(State.PLAYING)

    def _begin(self) -> None:
        """Make what comes next due now, forgetting what went before."""
        self._outstanding.clear()
        self._estimate_ns = None
        if self._playback.upcoming is not None:
            self._now_ns = self._playback.upcoming.log_time_ns
        latched = [topic for topic in playable.LATCHED if topic in self._outputs]
        for message in self._playback.before(self._now_ns, latched) if latched else ():
            self._outputs[message.topic].publish(message.data)
        self._restart_clock()

    def _restart_clock(self) -> None:
        """Let the bag's time run on from where it stands."""
        self._wall_start = time.monotonic()
        self._bag_start_ns = self._now_ns

    def _play(self) -> None:
        while (group := self._playback.upcoming) is not None:
            if self._paused and self._steps == 0:
                return
            if not (self._may_follow() if self._lock_step else self._is_due(group)):
                return
            self._publish_group(group)
            self._playback.advance()
        if self._values["loop"]:
            self._playback.rewind()
            self._begin()
        else:
            self._enter(State.DRAINING)

    def _is_due(self, group: Group) -> bool:
        if self._steps:
            return True
        elapsed_ns = (time.monotonic() - self._wall_start) * 1e9 * self._values["rate"]
        due = group.log_time_ns - self._bag_start_ns <= elapsed_ns
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

    def _publish_group(self, group: Group) -> None:
        self._now_ns = group.log_time_ns
        self._publish_clock()
        for message in group.messages:
            self._outputs[message.topic].publish(message.data)
        if group.stamp_ns is not None:
            self._steps = max(0, self._steps - 1)
        self._show(0 if group.stamp_ns is None else 1)
        answered = any(message.topic in self._played.detections for message in group.messages)
        if self._lock_step and answered and group.stamp_ns is not None:
            self._outstanding.append(group.stamp_ns)
            if len(self._outstanding) == 1:
                self._since = time.monotonic()

    def _show(self, scans: int = 0) -> None:
        doing = "paused" if self._paused else "plays"
        self._line.show(self._playback.seconds(self._now_ns), doing, scans)

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
        self._line.stop()
        if self._playback.damage is not None:
            self.exit_status = fail("sensor_replay", self._playback.damage)
        else:
            self.exit_status = OK

    def _fail(self, reason: str) -> None:
        self._line.stop()
        self.get_logger().error(reason)
        self.exit_status = FAILED

    def _publish_clock(self) -> None:
        self._clock_output.publish(Clock(clock=stamps.from_ns(self._now_ns)))

    def _on_estimate(self, cloud: PointCloud2) -> None:
        self._estimate_ns = stamps.to_ns(cloud.header.stamp)
        self._tick()

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = True
        self._show()
        return _done(response, "paused")

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = False
        self._restart_clock()
        self._show()
        return _done(response, "playing")

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._paused = True
        self._steps += 1
        return _done(response, "one stamp")

    def _check_seek(self, given: list[rclpy.Parameter]) -> SetParametersResult:
        faults = [self._seek_fault(p.value) for p in given if p.name == SEEK.name]
        reason = "; ".join(fault for fault in faults if fault)
        return SetParametersResult(successful=not reason, reason=reason)

    def _seek_fault(self, value: Any) -> str:
        """Return why the replay cannot go to `value`, or nothing if it can."""
        if self._state in (State.DRAINING, State.FLUSHING):
            return f"{SEEK.name}: {value} given, but the bag has been played to its end"
        seconds = SEEK.coerce(value)
        first, last = (
            self._playback.seconds(t) for t in (self._playback.first_ns, self._playback.last_ns)
        )
        if not isinstance(seconds, float) or not first <= seconds <= last:
            return f"{SEEK.name}: {value} given, must be a number from {first:g} to {last:g}"
        return ""

    def _seek(self, given: list[rclpy.Parameter]) -> None:
        for parameter in given:
            if parameter.name == SEEK.name:
                self._playback.seek(self._playback.time_ns(float(parameter.value)))
                self._begin()
                self._show()


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
