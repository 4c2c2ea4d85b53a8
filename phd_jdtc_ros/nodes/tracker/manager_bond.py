"""The bond to a lifecycle manager such as nav2's, which waits for one once a node is active.

A bond is a pair of heartbeats, by which each side notices the death of the other. It needs the
package ``bondpy``; without it a manager must not expect a bond (``bond_timeout: 0.0`` of nav2's).
"""

from __future__ import annotations

import importlib
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode

# As in nav2's nodes, the topic is in the node's namespace, and the bond has the node's name.
TOPIC = "bond"
HEARTBEAT_S = 0.1
# The longest time that the end of a bond waits for the manager's acknowledgement.
FAREWELL = Duration(seconds=2)


class ManagerBond:
    """One side of a bond, whose own thread sends heartbeats, so that no long step delays them."""

    def __init__(self, node: LifecycleNode, kind: Any) -> None:
        self._node = node
        self._ended = False
        publishers, subscriptions = set(node.publishers), set(node.subscriptions)
        self._bond = kind(
            node,
            TOPIC,
            node.get_name(),
            on_broken=self._on_broken,
            on_formed=lambda: node.get_logger().info("bond to the lifecycle manager formed"),
        )
        self._bond.heartbeat_period = HEARTBEAT_S
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
            publisher.wait_for_all_acked(FAREWELL)
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
