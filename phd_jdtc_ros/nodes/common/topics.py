"""Topics: QoS that users can override, full names, hints without a publisher, and lost messages.

Lost messages are counted by sequence numbers. Every publisher numbers its own messages, and they
arrive in order. A message does not name its publisher, so it is assigned to the publisher with the
nearest lower number.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from msg_adapters.encoding import interfaces
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.quoting import short


def reliable(depth: int) -> QoSProfile:
    """Return a reliable, volatile QoS.

    It is a new one each time, because rclpy writes overrides into the profile that it is given.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int) -> QoSProfile:
    """Return a new reliable QoS with which late subscribers receive the last messages too."""
    qos = reliable(depth)
    qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return qos


@contextmanager
def qos_of(topic: str) -> Iterator[None]:
    """Raise `ConfigError` with the parameter if a QoS override is not valid in this block.

    `topic` is the full name of the topic whose endpoint the block creates.
    """
    try:
        yield
    # Unknown policies, values of a wrong type and refusals are these errors of rclpy.
    except (RuntimeError, ParameterException, ValueError, InvalidQosOverridesError) as error:
        raise ConfigError(f"qos_overrides.{topic}: {error}") from error


def full_name(node: Node, topic: str, parameter: str, given: str | None = None) -> str:
    """Return the name of a topic after remapping.

    A `ConfigError` names the parameter that the topic comes from, if there cannot be a topic of
    this name. `given` is its value; None if the value is the topic itself.
    """
    try:
        name: str = node.resolve_topic_name(topic)
    except RuntimeError as error:  # The type of rcl's own error is private
        what = "topic" if given is None else "node"
        value = topic if given is None else given
        raise ConfigError(f"{parameter}: {value!r} given, must be a {what}'s name") from error
    return name


def subscribe(
    node: Node,
    message_type: type,
    topic: str,
    callback: Callable[..., None],
    depth: int,
    parameter: str,
    given: str | None = None,
) -> Subscription:
    """Subscribe reliably, unless ``qos_overrides.TOPIC.subscription`` has another reliability.

    `parameter`, `given` and errors are as in `full_name`; invalid QoS overrides are errors too.
    """
    options = QoSOverridingOptions.with_default_policies()
    with qos_of(full_name(node, topic, parameter, given)):
        return node.create_subscription(
            message_type, topic, callback, reliable(depth), qos_overriding_options=options
        )


def publisher_hint(node: Node, topic: str, message_class: type) -> str:
    """Return the fault of a topic without publishers of a type, empty if it has some.

    It lists other topics of that type, except for the node's own. `topic` is a full name.
    """
    # Largest number of topics in a hint.
    max_listed = 5
    expected = interfaces.type_name(message_class)
    types = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
    if expected in types:
        return ""
    if types:
        return f"{topic} is published as {', '.join(sorted(types))}, must be {expected}"
    found = _topics_of(node, expected)
    listed = ", ".join(map(short, found[:max_listed])) + (", ..." if found[max_listed:] else "")
    where = f"is on {listed}" if found else "is on no other topic"
    return f"no publisher on {topic}; {expected} {where}"


def _topics_of(node: Node, type_name: str) -> list[str]:
    """Return the topics on which other nodes publish messages of a type."""
    name, namespace = node.get_name(), node.get_namespace()
    own = {
        topic
        for listed in (
            node.get_subscriber_names_and_types_by_node(name, namespace),
            node.get_publisher_names_and_types_by_node(name, namespace),
        )
        for topic, _ in listed
    }
    return [
        topic
        for topic, types in node.get_topic_names_and_types()
        if type_name in types and topic not in own and node.count_publishers(topic)
    ]


# WINDOW is the number of latest messages that are considered. With MIN_DECREASES decreases of the
# number among them, several publishers are alive; a restart causes a single one.
WINDOW, MIN_DECREASES = 6, 2


@dataclass
class _Sequence:
    """One publisher's sequence of numbers."""

    number: int  # The number of its latest message
    received: int  # Number of messages received on the topic up to its latest message
    skipped: range = range(0)  # The numbers missing before its latest message


class SequenceNumbers:
    """The sequence numbers received on a topic.

    Messages that were published and not received are `lost`. With two publishers their number may
    fall, when a number arrives that was counted as lost.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._received = 0
        self._latest: int | None = None
        self._decreases: deque[bool] = deque(maxlen=WINDOW)
        self._sequences: list[_Sequence] = []

    def add(self, number: int) -> None:
        """Assign a message to the publisher with the nearest lower number, and count the gap."""
        self._received += 1
        self._decreases.append(self._latest is not None and number <= self._latest)
        self._latest = number
        # A dead publisher's sequence must not take its successor's numbers when they reach it.
        self._sequences = [s for s in self._sequences if self._received - s.received <= WINDOW]
        lower = [s for s in self._sequences if s.number < number]
        sequence = max(lower, key=lambda s: s.number) if lower else self._new_sequence(number)
        skipped = range(sequence.number + 1, number)
        if skipped:
            sequence.skipped = skipped
            self.lost += len(skipped)
        sequence.number, sequence.received = number, self._received

    def _new_sequence(self, number: int) -> _Sequence:
        """Return the sequence of another publisher, whose next message has `number`."""
        # If `number` was counted as lost in the gap of a sequence, the message after that gap came
        # from another publisher. The gap is taken back, and the new sequence begins before it.
        new = _Sequence(number - 1, self._received)
        for sequence in self._sequences:
            if number in sequence.skipped:
                self.lost -= len(sequence.skipped)
                new.number = sequence.skipped.start - 1
                sequence.skipped = range(0)
                break
        self._sequences.append(new)
        return new

    def begin_series(self) -> None:
        """Let the next message begin a new series, so that no gap before it counts as lost."""
        self._latest = None
        self._decreases.clear()
        self._sequences.clear()

    @property
    def several(self) -> bool:
        """Whether the latest messages come from several live publishers."""
        return sum(self._decreases) >= MIN_DECREASES
