"""Recording topics into a bag as the bytes they arrive as."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from msg_adapters import interfaces
from msg_adapters.bag import BagError, BagWriter, Topic

# Deep enough that a burst waits in the queue instead of being lost.
INPUT_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# For what was published once, before the recording began.
LATCHED_QOS = QoSProfile(
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# The radars' places: viewers need them to draw detections, which are in the radars' frames.
STATIC_FRAMES = "/tf_static"
STATIC_FRAMES_TYPE = "tf2_msgs/msg/TFMessage"


class Recorder:
    """Subscribes for a node and writes a bag, with the time of arrival as log time.

    ``/tf_static`` is recorded too, where tf2_msgs is installed.

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
        self._logger = node.get_logger()
        self._bag: BagWriter | None = BagWriter(directory)
        for topic, type_name in (_static_frames() | dict(topics)).items():
            latched = topic == STATIC_FRAMES
            self._bag.add_topic(Topic(topic, type_name, transient_local=latched))
            node.create_subscription(
                interfaces.message_class(type_name),
                topic,
                partial(self._write, topic),
                LATCHED_QOS if latched else INPUT_QOS,
                raw=True,
            )

    def _write(self, topic: str, data: bytes) -> None:
        if self._bag is None:
            return
        try:
            self._bag.write(topic, data, self._clock.now().nanoseconds)
        except BagError as error:  # a full disk ends the recording, not the node
            self._bag = None
            self._logger.error(f"recording stopped: {error}")

    def close(self) -> None:
        """Finish the bag."""
        if self._bag is None:
            return
        try:
            self._bag.close()
        except BagError as error:
            self._logger.error(f"recording not finished: {error}")


def _static_frames() -> dict[str, str]:
    """Return the topic of the static transforms with its type, where that is installed."""
    try:
        interfaces.message_class(STATIC_FRAMES_TYPE)
    except ImportError:
        return {}
    return {STATIC_FRAMES: STATIC_FRAMES_TYPE}
