"""What a tracker agrees on with others: that only one node has its name, and a manager's bond.

ROS allows two nodes of one name; both then answer its services and publish on its topics. So the
tracker claims its name and receives others' claims. The claim is a transient local message. The
middleware of a living node delivers it to every newcomer, even while the node is busy. A killed
node delivers nothing, even while the graph still lists it. So no node waits for a reply that may
never come.

A bond to a lifecycle manager, such as nav2's, is a pair of heartbeats, by which each side notices
the death of the other. It needs the package ``bondpy``; without it a manager must not expect a bond
(``bond_timeout: 0.0`` of nav2's).
"""

from __future__ import annotations

import importlib
import re
import time
import uuid
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from std_msgs.msg import String

from ..common.runtime import steady_timer
from ..common.topics import latched

# Time for which a newcomer gives way: on a busy machine discovery takes some seconds.
NEWCOMER_S = 5.0
TICK_S = 1.0
HOLDS, CLAIMS = "holds", "claims"


class NameClaim:
    """A node's claim to its full name.

    A newcomer gives way to a node that holds the name; of several newcomers the first one stays.
    After `NEWCOMER_S` a newcomer holds the name and no longer gives way. `on_taken` is called if
    another node has the name.
    """

    # This name is hidden from `ros2 topic list`.
    CLAIM_TOPIC = "~/_instance"
    # Number of claims that may arrive before the first is processed.
    MAX_CLAIMANTS = 50
    _CLAIM = re.compile(rf"({HOLDS}|{CLAIMS}) ([0-9]{{20}}) ([0-9a-f]{{32}})")

    def __init__(self, node: Node, on_taken: Callable[[], None]) -> None:
        self._node = node
        self._on_taken = on_taken
        self._state = CLAIMS
        # The second word orders nodes that start in the same nanosecond.
        self._seniority = f"{time.time_ns():020d}", uuid.uuid4().hex
        self._output = node.create_publisher(String, self.CLAIM_TOPIC, latched(1))
        node.create_subscription(
            String, self.CLAIM_TOPIC, self._on_claim, latched(self.MAX_CLAIMANTS)
        )
        self._elapsed_s = 0.0
        self._timer = steady_timer(node, TICK_S, self._tick)
        self._publish()

    def _publish(self) -> None:
        self._output.publish(String(data=" ".join([self._state, *self._seniority])))

    def _tick(self) -> None:
        """Count the time in which the node could process claims, unlike a clock of a busy node."""
        self._elapsed_s += TICK_S
        if self._elapsed_s >= NEWCOMER_S:
            self._timer.cancel()
            self._state = HOLDS
            self._publish()

    def _on_claim(self, message: String) -> None:
        claim = self._CLAIM.fullmatch(message.data)
        if claim is None:
            return
        state, *seniority = claim.groups()
        other = tuple(seniority)
        if other == self._seniority:
            return
        if self._state == CLAIMS and (state == HOLDS or other < self._seniority):
            self._on_taken()
        elif self._state == state == HOLDS:
            name = self._node.get_fully_qualified_name()
            self._node.get_logger().error(f"another node runs as {name} too: stop one of them")


class ManagerBond:
    """One side of a bond, whose own thread sends heartbeats, so that no long step delays them."""

    # As in nav2's nodes, the topic is in the node's namespace, and the bond has the node's name.
    BOND_TOPIC = "bond"
    HEARTBEAT_S = 0.1
    # The longest time that the end of a bond waits for the manager's acknowledgement.
    FAREWELL = Duration(seconds=2)

    def __init__(self, node: LifecycleNode, kind: Any) -> None:
        self._node = node
        self._ended = False
        publishers, subscriptions = set(node.publishers), set(node.subscriptions)
        self._bond = kind(
            node,
            self.BOND_TOPIC,
            node.get_name(),
            on_broken=self._on_broken,
            on_formed=lambda: node.get_logger().info("bond to the lifecycle manager formed"),
        )
        self._bond.heartbeat_period = self.HEARTBEAT_S
        self._bond.start()
        self._publishers = set(node.publishers) - publishers
        self._subscriptions = set(node.subscriptions) - subscriptions

    def end(self) -> None:
        """Break the bond, which tells the manager that the stop is intended, and remove it.

        bondpy destroys its endpoints at once, so that its last message can be lost, and leaves them
        in the node's lists, where the executor would wait for their events and fail.
        """
        self._ended = True
        self._bond.break_bond()
        for publisher in self._publishers:
            publisher.wait_for_all_acked(self.FAREWELL)
        self._bond.shutdown()
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _on_broken(self) -> None:
        if not self._ended:
            self._node.get_logger().info("no lifecycle manager has formed a bond")


def form(node: LifecycleNode) -> ManagerBond | None:
    """Begin a bond; return it, or None if ``bondpy`` is not installed."""
    try:
        kind = importlib.import_module("bondpy.bondpy").Bond
    except ImportError:
        node.get_logger().info(
            "no bond to a lifecycle manager, bondpy is not installed; nav2's manager needs "
            "bond_timeout: 0.0"
        )
        return None
    return ManagerBond(node, kind)
