"""Plays a bag's detections, truth and other topics, at a rate or in lock-step with a tracker."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.encoding import RejectedMessageError, interfaces, names, stamps
from msg_adapters.outgoing import manual
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.core.tracks.manual import VERBS
from phd_jdtc_ros.exit_status import FAILED, OK, fail
from phd_jdtc_ros.parameter_files import node_tables
from phd_jdtc_ros.parameter_files.node_tables import POSITION
from phd_jdtc_ros.parameter_files.sections import ParameterFile

from . import playback
from .common import parameters, runtime, topics
from .common.runtime import RunnableNode, serve
from .playback import GIVE_UP_S, BagClock, Group, LockStep, Playback, ProgressLine


class Operator:
    """Does the work that is given to it at a tracker, in order."""

    def __init__(self, node: Node, tracker: str) -> None:
        self._node = node
        self._clients = {
            verb: node.create_client(SetParametersAtomically, f"{tracker}/{verb}_track")
            for verb in VERBS
        }
        self._due: deque[bytes] = deque()
        self._called: tuple[str, Future, float] | None = None
        self.counts: Counter[str] = Counter()  # What became of the work: done, refused

    def add(self, data: bytes) -> None:
        """Add a serialised message of manual work."""
        self._due.append(data)

    def forget(self) -> None:
        """Forget what is due, because the recording goes on elsewhere."""
        self._due.clear()

    @property
    def has_work(self) -> bool:
        """Whether some work is to be done, or its answer is not there."""
        return self._called is not None or bool(self._due)

    def waits(self) -> bool:
        """Take an answer, do what is next, and return `has_work`."""
        if self._called is not None:
            words, answer, since_s = self._called
            if not answer.done():
                if time.monotonic() - since_s < GIVE_UP_S:
                    return True
                self._note("refused", f"{words}: no answer")
            elif answer.result().result.successful:
                self._note("done")
            else:
                self._note("refused", f"{words}: {answer.result().result.reason}")
            self._called = None
        if self._due:
            self._call(self._due.popleft())
        return self.has_work

    def _call(self, data: bytes) -> None:
        try:
            _, command = manual.from_msg(interfaces.decode(data, names.FIGURES))
        except RejectedMessageError as error:
            self._note("refused", str(error))
            return
        client = self._clients[command.verb]
        words = f"{client.srv_name} {command.track or ''}".rstrip()
        if not client.service_is_ready():
            self._note("refused", f"{words}: no such service")
            return
        request = SetParametersAtomically.Request(parameters=manual.to_request(command))
        self._called = words, client.call_async(request), time.monotonic()

    def _note(self, what: str, warning: str = "") -> None:
        self.counts[what] += 1
        if warning:
            self._node.get_logger().warning(f"recorded manual work: {warning}")


# The wait for subscribers of the truth is a share of that for subscribers of the detections, and at
# most MAX_TRUTH_S, because most replays have no evaluator.
TRUTH_SHARE, MAX_TRUTH_S = 0.2, 10.0
ACKNOWLEDGE_S = 5.0


class SensorReplay(RunnableNode):
    """Publishes a bag's messages with the bytes that were recorded.

    The bag is that of the parameters unless it is given.
    """

    DEPTH = 50
    CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

    CLOCK_PERIOD_S = 0.01
    TICK_S = 0.005

    def __init__(
        self,
        flags: dict[str, Any],
        files: Sequence[ParameterFile] = (),
        bag: BagReader | None = None,
    ) -> None:
        super().__init__("sensor_replay")
        self._values = parameters.resolve(self, node_tables.REPLAY, flags, files, replaced.REPLAY)
        bag = bag or BagReader(resources.bag(self._values["bag"]))
        self._played = playback.select(bag, self._values["topics"])
        for line in self._played.skipped:
            self.get_logger().warning(line)
        self._estimates = self.resolve_topic_name(names.estimates("filtered"))
        self._outputs = {
            topic: self._output(topic, message_class)
            for topic, message_class in self._played.classes.items()
        }
        self._clock_output = self.create_publisher(Clock, "/clock", self.CLOCK_QOS)
        self._published: Counter[str] = Counter()
        self._lock_step: LockStep | None = None
        if self._values["rate"] == 0.0:
            self._lock_step = self._subscribe_to_replies()
        self._flush = (
            self.create_client(Trigger, self._values["flush_service"])
            if self._values["flush_service"]
            else None
        )
        self._flushed: Future | None = None
        self._paused = bool(self._values["start_paused"])
        self._steps = 0
        self._enter(self._wait_for_subscribers)
        self._ready_since: float | None = None
        self._operator = Operator(self, names.tracker_of(self._estimates))
        self._playback = Playback(
            bag,
            [*self._played.classes, *self._played.manual],
            self._played.scan_topics,
            self._values["start_s"],
            self._values["duration_s"],
        )
        self._bag_clock = BagClock(self._values["rate"], bag.start_ns)
        self._line = ProgressLine(*self._part_s)
        for name, action in {
            "pause": self._pause,
            "resume": self._resume,
            "step": self._step,
        }.items():
            serve(self, name, action)
        # Seeking is a parameter, because std_srvs has no service that takes a number.
        self.add_on_set_parameters_callback(self._check_seek)
        self.add_post_set_parameters_callback(self._seek)
        playback.begin(self, bag.path, self._estimates)
        self.create_timer(self.CLOCK_PERIOD_S, self._publish_clock)
        self.create_timer(self.TICK_S, self._tick)

    def _output(self, topic: str, message_class: Any) -> Publisher:
        latched = topic in playback.LATCHED
        qos = topics.latched(self.DEPTH) if latched else topics.reliable(self.DEPTH)
        return self.create_publisher(message_class, topic, qos)

    def _subscribe_to_replies(self) -> LockStep:
        """Subscribe to the tracker's reply to a scan: estimates, or figures if these come later."""
        topic, delay_s = self._estimates, self._values["answer_delay_s"]
        reply: Any = PointCloud2
        if delay_s:
            topic, reply = names.cardinality(names.tracker_of(topic)), DiagnosticArray
        self._reply_topic = topic
        self.create_subscription(reply, topic, self._on_reply, topics.reliable(self.DEPTH))
        return LockStep(delay_s)

    @property
    def _part_s(self) -> tuple[float, float]:
        """The part that is played, seconds since the bag's start."""
        first_ns, last_ns = self._playback.first_ns, self._playback.last_ns
        return self._playback.seconds(first_ns), self._playback.seconds(last_ns)

    def close(self) -> None:
        """Stop the progress line and log how much was published."""
        self._line.stop()
        counts = [f"{topic} {self._published[topic]}" for topic in self._played.scan_topics]
        work = [f"manual work {what} {count}" for what, count in self._operator.counts.items()]
        self.get_logger().info(f"published: {', '.join([*counts, *work]) or 'no scans'}")

    def _tick(self) -> None:
        self._phase()

    def _enter(self, phase: Callable[[], None]) -> None:
        self._phase = phase
        self._since = time.monotonic()

    def _wait_for_subscribers(self) -> None:
        now = time.monotonic()
        missing = self._missing()
        if missing and now - self._since < self._values["subscriber_timeout_s"]:
            self._ready_since = None
            return
        if missing:
            self._play_without(missing)
        else:
            self._ready_since = self._ready_since or now
            waited_s = now - self._ready_since
            unconnected = [topic for topic in self._played.truth if not self._is_connected(topic)]
            longest_s = min(TRUTH_SHARE * self._values["subscriber_timeout_s"], MAX_TRUTH_S)
            # The graph shows endpoints some time before they are connected.
            if waited_s < max(0.5, longest_s if unconnected else 0.0):
                return
            if unconnected:
                self._play_without(unconnected)
        self._begin()
        self._enter(self._play)

    def _missing(self) -> list[str]:
        """Return the topics that lack a subscriber, or a tracker, to play to."""
        awaited = self._played.detections or self._outputs
        missing = [topic for topic in awaited if not self._is_connected(topic)]
        if self._lock_step and not self.count_publishers(self._estimates):
            missing.append(self._estimates)
        return missing

    def _is_connected(self, topic: str) -> bool:
        wanted = self._values["subscribers"] if topic in self._played.scan_topics else 1
        return int(self._outputs[topic].get_subscription_count()) >= wanted

    def _play_without(self, topics: Sequence[str]) -> None:
        wanted = self._values["subscribers"]
        connected = "nothing is" if wanted == 1 else f"fewer than {wanted} subscribers are"
        waited_s = time.monotonic() - self._since
        self.get_logger().warning(
            f"{connected} connected to {', '.join(topics)} after {waited_s:.0f} s: playing anyway"
        )

    def _begin(self) -> None:
        """Start at the next group: forget awaited replies and publish earlier latched messages."""
        if self._lock_step:
            self._lock_step.begin()
        self._operator.forget()
        if self._playback.upcoming is not None:
            self._bag_clock.now_ns = self._playback.upcoming.log_time_ns
        latched = [topic for topic in playback.LATCHED if topic in self._outputs]
        for message in self._playback.before(self._bag_clock.now_ns, latched) if latched else ():
            self._outputs[message.topic].publish(message.data)
        self._bag_clock.restart()

    def _play(self) -> None:
        while (group := self._playback.upcoming) is not None:
            if self._operator_waits() or (self._paused and self._steps == 0):
                return
            if not self._is_due(group):
                return
            self._publish_group(group)
            self._playback.advance()
        if self._operator_waits():
            return
        if not self._values["loop"]:
            self._enter(self._drain)
        # In lock-step, the first scan of the next pass waits for the last scan of this one too.
        elif self._is_settled():
            self._playback.seek(self._playback.first_ns)
            self._begin()

    def _operator_waits(self) -> bool:
        """Whether manual work comes before the next scan; in lock-step behind the latest estimate.

        The work of a message that was recorded within a scan is done after it.
        """
        return self._operator.has_work and (not self._is_settled() or self._operator.waits())

    def _is_due(self, group: Group) -> bool:
        if self._lock_step is None:
            return self._steps > 0 or self._bag_clock.is_due(group.log_time_ns)
        # A scan may wait for messages between it and the next one, such as a pose.
        if group.stamp_ns is None:
            return True
        now = time.monotonic()
        if self._lock_step.has_timed_out(now):
            self._fail(f"no reply on {self._reply_topic} for {GIVE_UP_S:g} s")
            return False
        return self._lock_step.may_follow(now)

    def _is_settled(self) -> bool:
        return self._lock_step is None or self._lock_step.is_settled(time.monotonic())

    def _publish_group(self, group: Group) -> None:
        self._bag_clock.now_ns = group.log_time_ns
        self._publish_clock()
        for message in group.messages:
            if message.topic in self._played.manual:
                self._operator.add(message.data)
                continue
            self._outputs[message.topic].publish(message.data)
            self._published[message.topic] += 1
        if group.stamp_ns is not None:
            self._steps = max(0, self._steps - 1)
        self._show(0 if group.stamp_ns is None else 1)
        awaited = any(message.topic in self._played.detections for message in group.messages)
        if self._lock_step and awaited and group.stamp_ns is not None:
            self._lock_step.expect(group.stamp_ns, time.monotonic())

    def _show(self, scans: int = 0) -> None:
        doing = "paused" if self._paused else "playing"
        self._line.show(self._playback.seconds(self._bag_clock.now_ns), doing, scans)

    def _drain(self) -> None:
        """Wait until all messages have arrived, then flush the tracker if requested."""
        if not self._is_settled():
            return
        waited_s = time.monotonic() - self._since
        # Longest wait for acknowledgements at a time, because it delays signals.
        poll = Duration(seconds=0.05)
        arrived = all(output.wait_for_all_acked(poll) for output in self._outputs.values())
        if not arrived and waited_s < ACKNOWLEDGE_S:
            return
        if self._flush is None:
            self._end()
        elif self._flush.service_is_ready():
            self._flushed = self._flush.call_async(Trigger.Request())
            self._enter(self._finish_flush)
        elif waited_s > ACKNOWLEDGE_S:
            self._fail(f"service {self._values['flush_service']} is not available")

    def _finish_flush(self) -> None:
        if self._flushed is not None and self._flushed.done():
            reply = self._flushed.result()
            if reply.success:
                self._end()
            else:
                self._fail(f"service {self._values['flush_service']} refused: {reply.message}")
        elif time.monotonic() - self._since > GIVE_UP_S:
            self._fail(f"service {self._values['flush_service']} did not answer")

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
        self._clock_output.publish(Clock(clock=stamps.from_ns(self._bag_clock.now_ns)))

    def _on_reply(self, reply: Any) -> None:
        if self._lock_step:
            self._lock_step.receive(stamps.to_ns(reply.header.stamp), time.monotonic())
        self._tick()

    def _pause(self) -> tuple[bool, str]:
        self._paused = True
        self._show()
        return True, "paused"

    def _resume(self) -> tuple[bool, str]:
        self._paused = False
        self._restart_clock()
        self._show()
        return True, "playing"

    def _step(self) -> tuple[bool, str]:
        self._paused = True
        self._steps += 1
        self._restart_clock()
        return True, "one scan"

    def _restart_clock(self) -> None:
        """Let the time run on after a pause."""
        self._bag_clock.restart()
        if self._lock_step:
            self._lock_step.restart(time.monotonic())

    def _check_seek(self, given: list[Parameter]) -> SetParametersResult:
        faults = (self._seek_fault(each.value) for each in given if each.name == "start_s")
        reason = "; ".join(filter(None, faults))
        return SetParametersResult(successful=not reason, reason=reason)

    def _seek_fault(self, value: Any) -> str:
        """Return the reason for which the replay cannot go to `value`; empty if it can."""
        if self._phase in (self._drain, self._finish_flush):
            return f"start_s: {value} given, but the bag has been played to its end"
        seconds = POSITION.read(value)
        first, last = self._part_s
        if not isinstance(seconds, float) or not first <= seconds <= last:
            return f"start_s: {value} given, must be a number from {first:g} to {last:g}"
        return ""

    def _seek(self, given: list[Parameter]) -> None:
        for each in (each for each in given if each.name == "start_s"):
            self._playback.seek(self._playback.time_ns(float(each.value)))
            self._begin()
            self._show()


def main(argv: Sequence[str]) -> int:
    """Run the replay node."""
    others, files = parameters.split("sensor_replay", argv)
    flags = node_tables.flags(others)
    return runtime.run("sensor_replay", lambda: SensorReplay(flags, files), argv)
