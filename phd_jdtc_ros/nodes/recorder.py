"""What the evaluator receives: topics recorded into a bag, and how much of the truth was scored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.comparison import LONGEST_INTERPOLATION_S
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.quoting import counted

from .common import topics as endpoints
from .common.runtime import steady_timer
from .common.topics import SequenceNumbers

CHECK_PERIOD_S = 0.5
# Types of the tracker's inputs, and what the tracker has of them.
KINDS = {
    **{reader.type_name: "a radar's detections" for reader in READERS.values()},
    **dict.fromkeys(moving_radars.MESSAGE_TYPES.values(), "the poses of a radar that moves"),
}


class Recorder:
    """Subscribes for a node and writes a bag, with the time of arrival as log time.

    It subscribes reliably, so that nothing is lost, and best effort if a publisher offers no more.
    ``/tf_static`` is recorded too if tf2_msgs is installed. A bag of a live tracker has its
    parameters beside it.

    `optional` are topics that are in the bag only if they have messages; their types need not be
    installed. `written` counts the recorded messages by topic.
    """

    # Depth at which a burst waits in the queue instead of being lost.
    DEPTH = 1000

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
            qos = endpoints.latched(self.DEPTH) if latched else endpoints.reliable(self.DEPTH)
            self._subscribe(topic, type_name, qos)
        for topic, type_name in self._undeclared.items():
            self._subscribe(topic, type_name, endpoints.reliable(self.DEPTH))

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
        qos = QoSProfile(depth=self.DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscribe(topic, type_name, qos)

    def _write(self, topic: str, data: bytes) -> None:
        if self._bag is None:
            return
        try:
            if topic in self._undeclared:
                self._bag.add_topic(Topic(topic, self._undeclared.pop(topic)))
            self._bag.write(topic, data, self._clock.now().nanoseconds)
            self.written[topic] += 1
        except BagError as error:  # A full disk ends the recording, not the node.
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
    # Length of the prefix of a DDS identifier (GUID) that is its participant's.
    return tuple(endpoint.endpoint_gid[:12])


@dataclass
class ReceivedClouds:
    """Counts the clouds of the truth and of the estimates."""

    truth: str  # Its topic
    estimates: Mapping[str, str]  # Their topics by source
    # Numbers of valid and of invalid clouds by topic.
    received: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    _first_ns: dict[str, int] = field(default_factory=dict)
    _numbers: dict[str, SequenceNumbers] = field(default_factory=dict)

    def count_losses(self, topic: str, sequence: int | None) -> None:
        """Count the clouds lost before this one, by its publisher's number for it."""
        if sequence is not None:
            self._numbers.setdefault(topic, SequenceNumbers()).add(sequence)

    def take(self, topic: str, stamp_ns: int) -> None:
        """Count a valid cloud."""
        self.received[topic] += 1
        self._first_ns.setdefault(topic, stamp_ns)

    def mismatch(self, evaluation: Evaluation) -> str | None:
        """Return the warning that no stamps are common, once there are enough; None otherwise."""
        # A warning is due once this many stamps, of the truth and of the estimates, have none in
        # common.
        few = min(self.received[self.truth], max(map(self._count, SOURCES))) < 20
        return None if few or any(evaluation.scored.values()) else self._no_common_time()

    def no_score_reason(self) -> str:
        """Return the reason for which no scan has been scored."""
        found = sum(map(self._count, SOURCES))
        if not self.received[self.truth] and not found:
            return f"nothing is scored: neither truth on {self.truth} nor estimates were received"
        if not self.received[self.truth]:
            return f"nothing is scored: no truth was received on {self.truth}"
        if not found:
            topics = " or ".join(self.estimates.values())
            return f"nothing is scored: no estimates were received on {topics}"
        return self._no_common_time()

    def gaps(self, evaluation: Evaluation) -> Iterator[str]:
        """Yield the numbers of scans and clouds that were not scored, by reason."""
        for source, scored in evaluation.scored.items():
            missing = 0 if evaluation.own_stamps else evaluation.truth_scans - scored
            if missing:
                scans = counted(evaluation.truth_scans, "scan[ has|s have]")
                yield f"{missing} of {scans} no {source} estimates"
        for topic, numbers in sorted(self._numbers.items()):
            if numbers.lost:
                yield f"{counted(numbers.lost, 'message[s]')} on {topic} lost on the way"
        for topic, count in sorted(self.refused.items()):
            yield f"{counted(count, 'cloud[s]')} on {topic} rejected"
        if evaluation.repeated:
            yield f"{counted(evaluation.repeated, 'cloud[s]')} repeated a stamp"

    def _count(self, source: str) -> int:
        return self.received[self.estimates[source]]

    def _no_common_time(self) -> str:
        topics = [self.truth, *(t for t in self.estimates.values() if t in self._first_ns)]
        firsts = ", ".join(f"{t} begins at {self._first_ns[t] / 1e9:.3f} s" for t in topics)
        return (
            "nothing is scored: no estimates are at a stamp of the truth, or between two that are "
            f"at most {LONGEST_INTERPOLATION_S:g} s apart ({firsts})"
        )


class Completion:
    """Decides when enough stamps are scored, and late messages have had time to arrive.

    `wanted` is the number of stamps; 0 if the evaluation has no end.
    """

    # Time after the last score in which further messages can still arrive for the recording,
    # seconds.
    LINGER_S = 0.5

    def __init__(self, evaluation: Evaluation, wanted: int) -> None:
        self._evaluation, self._wanted = evaluation, wanted
        self._progress: tuple[int, ...] = ()
        self._since_s = 0.0

    def is_reached(self, now_s: float, recorded: int) -> bool:
        """Return whether no score was added for `LINGER_S` after the wanted number, or recorded.

        `recorded` is the number of the scores that are in the recording: on a busy machine the last
        ones wait longer for their turn.
        """
        scored = tuple(self._evaluation.scored.values())
        if not self._wanted or not self._is_enough(scored):
            return False
        if (*scored, recorded) != self._progress:
            self._progress, self._since_s = (*scored, recorded), now_s
        return now_s - self._since_s >= self.LINGER_S

    def _is_enough(self, scored: Sequence[int]) -> bool:
        """Return whether the wanted number of stamps has the scores of both sources.

        The number of estimates with stamps of their own is not known in advance, and the truth may
        have stamps before the first detection and after the last. Then the truth must have that
        number of stamps, and both sources the same number of scores.
        """
        if min(scored) >= self._wanted and not self._evaluation.own_stamps:
            return True
        return self._evaluation.truth_scans >= self._wanted and 0 < min(scored) == max(scored)
