"""Nodes that publish what they receive from sockets and serial lines.

While such a node is active, a thread receives and wakes it; a timer notices that nothing comes.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import FAILED
from phd_jdtc_ros.transport.network import Datagram
from phd_jdtc_ros.transport.sockets import Input, Receiver

from . import topics
from .health import Rises
from .runtime import ManagedNode, steady_timer


class Moment(NamedTuple):
    """Values that the statuses of one report share."""

    node: str  # Full name of the node
    rises: Rises  # Increases of all counts since the node was made
    active_s: float  # Time for which the node has been active; NaN while it is not
    now_s: float

    def recent(self, name: str, count: int) -> int:
        """Return by how much a count has risen recently."""
        return self.rises.recent(name, count, self.now_s)

    def quiet_s(self, name: str, count: int) -> float:
        """Return the time since a count last rose while the node was active, seconds."""
        return min(self.rises.unchanged_s(name, count, self.now_s), self.active_s)

    @property
    def inactive(self) -> tuple[bytes, bool, str]:
        """The condition that the node is not active."""
        return DiagnosticStatus.STALE, math.isnan(self.active_s), "not active"


def nothing_received(what: str, quiet_s: float, inputs: Sequence[str]) -> str:
    """Return the warning about inputs on which nothing has arrived for some time."""
    return (
        f"no {what} for {quiet_s:.0f} s on {', '.join(inputs)}; check the address and port that "
        "the sender uses, and interface for a group"
    )


class ReceivingNode(ManagedNode):
    """A lifecycle node that receives while it is active."""

    OUTPUT_DEPTH = 50
    # Longest time of processing data at once, seconds, so that a flood of it does not keep the node
    # from everything else, and from being stopped.
    BUDGET_S = 0.05
    # Nothing late is expected after this time without data, seconds. Without any since the start,
    # the address is probably wrong.
    QUIET_S = 5.0

    received = "datagram"
    """What arrives, in words."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._receiver: Receiver | None = None
        # The rest of the piece of data that was taken last.
        self._work: Iterator[object] = iter(())
        self._received_s: float | None = None
        self._active_since_s = math.nan
        self._deaf = False
        self._rises = Rises()
        self._lost = 0
        self._outputs: dict[str, Publisher] = {}
        self._subscribers: dict[str, int] = {}
        self._arrived = self.create_guard_condition(self._take)
        # The timer runs by the wall clock, because senders do not follow simulated time.
        steady_timer(self, self.QUIET_S / 5.0, self._finish_if_quiet)

    @property
    @abstractmethod
    def pieces(self) -> int:
        """Number of pieces of data since the node was configured."""

    @abstractmethod
    def inputs(self) -> tuple[Sequence[Input], str]:
        """Return the inputs, and the network interface for groups."""

    @abstractmethod
    def process(self, received: Datagram) -> Iterator[object]:
        """Publish what a piece of data completes; yield often, so that other work can be done."""

    @abstractmethod
    def finish(self) -> None:
        """Publish what waits for more data."""

    @property
    def lost(self) -> int:
        """Number of pieces of data for which there was no room."""
        return self._lost + (self._receiver.lost if self._receiver is not None else 0)

    @property
    def disconnected(self) -> Mapping[str, str]:
        """The streams that nothing comes from, each with the reason."""
        return {} if self._receiver is None else self._receiver.disconnected

    @property
    def moment(self) -> Moment:
        """The present time and state for statuses."""
        now_s = time.monotonic()
        node, active_s = self.get_fully_qualified_name(), now_s - self._active_since_s
        return Moment(node, self._rises, active_s, now_s)

    @property
    def _listed(self) -> list[str]:
        return list(map(str, self.inputs()[0]))

    def add_output(self, topic: str) -> Publisher:
        """Return the publisher of clouds on a topic, which is made when it is first needed."""
        if topic not in self._outputs:
            qos = topics.reliable(self.OUTPUT_DEPTH)
            self._outputs[topic] = self.create_publisher(PointCloud2, topic, qos)
            self.get_logger().info(f"{topic}: publishing on {self._outputs[topic].topic_name}")
        return self._outputs[topic]

    def log_subscribers(self) -> None:
        """Log changes of the number of subscribers to each topic of clouds."""
        for topic, output in self._outputs.items():
            count = output.get_subscription_count()
            if count != self._subscribers.get(topic, 0):
                self.get_logger().info(f"{topic}: {count} subscribers")
                self._subscribers[topic] = count

    def close(self) -> None:
        """Stop receiving; fail if nothing was received."""
        self.stop()
        if self._deaf:
            self.exit_status = FAILED

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Receive from now on; stay inactive if an address cannot be used."""
        try:
            self.open()
        except OSError as error:
            self.stop()
            return self.refuse("not activated", ConfigError(f"{error.filename}: {error.strerror}"))
        done = super().on_activate(state)
        self._active_since_s = time.monotonic()
        self.get_logger().info(f"receiving {', '.join(self._listed) or 'nothing'}")
        return done

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish what waits, and stop receiving."""
        self._work = iter(())
        self._finish()
        self.stop()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop receiving."""
        self.stop()
        return super().on_shutdown(state)

    def open(self) -> None:
        """Open the inputs; an `OSError` has the address as its ``filename``."""
        inputs, interface = self.inputs()
        if inputs:
            self._receiver = Receiver(inputs, interface, self._arrived.trigger)

    def stop(self) -> None:
        """Close the inputs."""
        if self._receiver is not None:
            self._note_silence()
            self._receiver.close()
            self._lost += self._receiver.lost + self._receiver.waiting
            self._receiver, self._work = None, iter(())
            if self._deaf:
                self.get_logger().error(f"nothing was received on {', '.join(self._listed)}")
        self._active_since_s = math.nan

    def _take(self) -> None:
        """Process what was received, for `BUDGET_S` at most."""
        until_s, nothing = time.monotonic() + self.BUDGET_S, object()
        while self._receiver is not None:
            if next(self._work, nothing) is nothing:
                received = self._receiver.take()
                if received is None:
                    return
                self._received_s = time.monotonic()
                self._work = self.process(received)
            if time.monotonic() > until_s:
                self._arrived.trigger()
                return

    def _note_silence(self) -> None:
        """Find out, and warn once, that nothing at all has been received for a while."""
        active_s, warned = time.monotonic() - self._active_since_s, self._deaf
        self._deaf = active_s > self.QUIET_S and not self.pieces
        if self._deaf and not warned:
            self.get_logger().warning(nothing_received(self.received, active_s, self._listed))

    def _finish_if_quiet(self) -> None:
        if self._receiver is not None:
            self._note_silence()
        if self._received_s is not None and time.monotonic() - self._received_s > self.QUIET_S:
            self._finish()

    def _finish(self) -> None:
        self._received_s = None
        self.finish()
