"""Records topics into a bag as serialised bytes, and warns of inputs that are not recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.parameter_files import bag_parameters

from ..common import topics as endpoints
from ..common.callbacks import steady_timer

# Depth at which a burst waits in the queue instead of being lost.
DEPTH = 1000

CHECK_PERIOD_S = 0.5
# Length of the prefix of a DDS identifier (GUID) that is its participant's.
PARTICIPANT_BYTES = 12
# Types of the tracker's inputs, and what the tracker has of them.
KINDS = {
    **{reader.type_name: "a radar's detections" for reader in READERS.values()},
    **dict.fromkeys(moving_radars.TYPES.values(), "the poses of a radar that moves"),
}


class Recorder:
    """Subscribes for a node and writes a bag, with the time of arrival as log time.

    It subscribes reliably, so that nothing is lost, and best effort if a publisher offers no more.
    ``/tf_static`` is recorded too if tf2_msgs is installed. A bag of a live tracker has its
    parameters beside it.

    `optional` are topics that are in the bag only if they have messages; their types need not be
    installed. `written` counts the recorded messages by topic.
    """

    def __init__(
        self,
        node: Node,
        directory: Path,
        topics: Mapping[str, str],
        optional: Mapping[str, str] | None = None,
    ) -> None:
        self._node = node
        self._directory = directory
        self._clock = node.get_clock()
        self._logger = node.get_logger()
        self._bag: BagWriter | None = BagWriter(directory)
        self.written: Counter[str] = Counter()
        self._subscriptions: dict[str, Subscription] = {}
        installed = interfaces.installed_class
        self._undeclared = {t: kind for t, kind in (optional or {}).items() if installed(kind)}
        frames = {names.STATIC_FRAMES: names.TRANSFORMS} if installed(names.TRANSFORMS) else {}
        try:
            self._subscribe_all(self._bag, frames | dict(topics))
        except Exception:
            self.close()
            raise

    def _subscribe_all(self, bag: BagWriter, topics: Mapping[str, str]) -> None:
        for topic, type_name in topics.items():
            latched = topic == names.STATIC_FRAMES
            bag.add_topic(Topic(topic, type_name, transient_local=latched))
            qos = endpoints.latched(DEPTH) if latched else endpoints.reliable(DEPTH)
            self._subscribe(topic, type_name, qos)
        for topic, type_name in self._undeclared.items():
            self._subscribe(topic, type_name, endpoints.reliable(DEPTH))

    def _subscribe(self, topic: str, type_name: str, qos: QoSProfile) -> None:
        self._subscriptions[topic] = self._node.create_subscription(
            interfaces.message_class(type_name),
            topic,
            partial(self._write, topic),
            qos,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=partial(self._fall_back, topic, type_name)
            ),
            raw=True,
        )

    def _fall_back(self, topic: str, type_name: str, event: Any) -> None:
        """Subscribe best effort instead, if a publisher does not offer reliable messages."""
        if event.last_policy_kind != QoSPolicyKind.RELIABILITY:
            self._logger.warning(f"{topic}: a publisher's QoS is incompatible, it is not recorded")
            return
        self._logger.info(f"{topic}: offered best effort, recorded best effort")
        self._node.destroy_subscription(self._subscriptions[topic])
        qos = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscribe(topic, type_name, qos)

    def _write(self, topic: str, data: bytes) -> None:
        if self._bag is None:
            return
        try:
            if topic in self._undeclared:
                self._bag.add_topic(Topic(topic, self._undeclared.pop(topic)))
            self._bag.write(topic, data, self._clock.now().nanoseconds)
            self.written[topic] += 1
        except BagError as error:  # a full disk ends the recording, not the node
            self._bag = None
            self._logger.error(f"recording stopped: {error}")

    def write_parameters(self, values: Mapping[str, Any]) -> None:
        """Write the tracker's parameters, by dotted name, beside the bag."""
        try:
            bag_parameters.write(self._directory / bag_parameters.NAME, values)
        except BagError as error:
            self._logger.warning(f"the tracker's parameters are not recorded: {error}")

    def close(self) -> None:
        """Finish the bag."""
        if self._bag is None:
            return
        try:
            self._bag.close()
        except BagError as error:
            self._logger.error(f"recording not finished: {error}")


def watch_inputs(node: Node, tracker: str, recorded: Collection[str]) -> None:
    """Warn of the tracker's inputs, as the graph shows them, that are not among `recorded`."""
    known = set(recorded)

    def check() -> None:
        for topic, types in _inputs(node, tracker):
            kinds = [KINDS[kind] for kind in types if kind in KINDS]
            if kinds and topic not in known:
                known.add(topic)
                node.get_logger().warning(
                    f"{topic}, of which {tracker} has {kinds[0]}, is not among record_topics and "
                    "is not recorded"
                )

    steady_timer(node, CHECK_PERIOD_S, check)


def _inputs(node: Node, tracker: str) -> list[tuple[str, list[str]]]:
    """Return the topics to which a tracker subscribes, with their types.

    Fast DDS forgets a node that it has not heard for a while, as on a busy machine, and then finds
    its endpoints again but not its name. They are recognised by the process of its outputs.
    """
    namespace, _, name = tracker.rpartition("/")
    try:
        return list(node.get_subscriber_names_and_types_by_node(name, namespace or "/"))
    except NodeNameNonExistentError:
        outputs = node.get_publishers_info_by_topic(names.cardinality(tracker))
        own = {_participant(output) for output in outputs}
        return [
            (topic, types)
            for topic, types in node.get_topic_names_and_types()
            if not own.isdisjoint(map(_participant, node.get_subscriptions_info_by_topic(topic)))
        ]


def _participant(endpoint: TopicEndpointInfo) -> tuple[int, ...]:
    """Return the part of an endpoint's identifier that all endpoints of a process share."""
    return tuple(endpoint.endpoint_gid[:PARTICIPANT_BYTES])
