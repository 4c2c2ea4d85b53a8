"""Ensures that only one node has a name: the tracker claims its name and receives others' claims.

ROS allows two nodes of one name; both then answer its services and publish on its topics. The claim
is a transient local message. The middleware of a living node delivers it to every newcomer, even
while the node is busy. A killed node delivers nothing, even while the graph still lists it. So no
node waits for a reply that may never come.
"""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import String

from ..common.runtime import steady_timer
from ..common.topics import latched

# This name is hidden from `ros2 topic list`.
TOPIC = "~/_instance"
# Time for which a newcomer gives way: on a busy machine discovery takes some seconds.
NEWCOMER_S = 5.0
TICK_S = 1.0
# Number of claims that may arrive before the first is processed.
MAX_CLAIMANTS = 50
HOLDS, CLAIMS = "holds", "claims"
_CLAIM = re.compile(rf"({HOLDS}|{CLAIMS}) ([0-9]{{20}}) ([0-9a-f]{{32}})")


class NameClaim:
    """A node's claim to its full name.

    A newcomer gives way to a node that holds the name; of several newcomers the first one stays.
    After `NEWCOMER_S` a newcomer holds the name and no longer gives way. `on_taken` is called if
    another node has the name.
    """

    def __init__(self, node: Node, on_taken: Callable[[], None]) -> None:
        self._node = node
        self._on_taken = on_taken
        self._state = CLAIMS
        # The second word orders nodes that start in the same nanosecond.
        self._seniority = f"{time.time_ns():020d}", uuid.uuid4().hex
        self._output = node.create_publisher(String, TOPIC, latched(1))
        node.create_subscription(String, TOPIC, self._on_claim, latched(MAX_CLAIMANTS))
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
        claim = _CLAIM.fullmatch(message.data)
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
