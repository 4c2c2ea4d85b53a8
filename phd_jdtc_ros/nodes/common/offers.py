"""Says where messages of a type are published, for who listens on a topic that has none."""

from __future__ import annotations

from rclpy.node import Node

from msg_adapters import interfaces
from phd_jdtc_ros.quoting import short

# At most so many topics are named.
NAMED = 5


def hint(node: Node, topic: str, message_class: type) -> str:
    """Return what is wrong with a topic that has no publisher, or only those of another type.

    Parameters
    ----------
    node : Node
        Who listens; topics that it has itself are not named.
    topic : str
        Full name.

    Returns
    -------
    str
        Empty if messages of the type are published on the topic.
    """
    wanted = interfaces.type_name(message_class)
    types = {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
    if wanted in types:
        return ""
    if types:
        return f"{topic} is published as {', '.join(sorted(types))}, must be {wanted}"
    found = _offered(node, wanted)
    listed = ", ".join(map(short, found[:NAMED])) + (", ..." if len(found) > NAMED else "")
    where = f"is on {listed}" if found else "is on no other topic"
    return f"nobody publishes on {topic}; {wanted} {where}"


def _offered(node: Node, wanted: str) -> list[str]:
    """Return the topics with messages of a type, without those that the node has itself."""
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
        if wanted in types and topic not in own and node.count_publishers(topic)
    ]
