"""Recording topics into a bag as the bytes they arrive as."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from msg_adapters import interfaces
from msg_adapters.bag import BagWriter, Topic

# Deep enough that a burst waits in the queue instead of being lost.
INPUT_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


class Recorder:
    """Subscribes for a node and writes a bag, with the time of arrival as log time.

    Parameters
    ----------
    node : Node
        Whose executor delivers the messages.
    directory : Path
        Of the new bag.
    topics : mapping of topic to type name
    """

    def __init__(self, node: Node, directory: Path, topics: Mapping[str, str]) -> None:
        self._clock = node.get_clock()
        self._bag = BagWriter(directory)
        for topic, type_name in topics.items():
            self._bag.add_topic(Topic(topic, type_name))
            node.create_subscription(
                interfaces.message_class(type_name),
                topic,
                partial(self._write, topic),
                INPUT_QOS,
                raw=True,
            )

    def _write(self, topic: str, data: bytes) -> None:
        self._bag.write(topic, data, self._clock.now().nanoseconds)

    def close(self) -> None:
        """Finish the bag."""
        self._bag.close()
